"""The note that iPhones leave in the EXIF of their photos."""

import struct


def apple_note(entries):
    """A big-endian folder of signed rationals by number, behind another; offsets count from the note's start."""
    head = b"Apple iOS\0\0\x01MM" + struct.pack(">H", 1 + len(entries)) + struct.pack(">HHIi", 1, 9, 1, 14)
    at, values = len(head) + 12 * len(entries) + 4, b""
    for number, numbers in entries.items():
        head += struct.pack(">HHII", number, 10, len(numbers), at + len(values))
        values += b"".join(struct.pack(">ii", round(value * 10000), 10000) for value in numbers)
    return head + bytes(4) + values
