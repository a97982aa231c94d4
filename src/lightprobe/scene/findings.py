"""Lines and sentences about photos that inspections of scenes and of plain photos have in common."""

from collections import Counter
from collections.abc import Iterable, Sequence

from lightprobe.imaging import UNREADABLE
from lightprobe.scene.photo import Photo

_SHOWN = 20  # problems printed


def numbered(kind: str, messages: Sequence[str]) -> list[str]:
    """Return a headline with the count and the first messages, or nothing for hints that are not there."""
    if not messages:
        return [f"no {kind}s"] if kind == "problem" else []
    head = f"{len(messages)} {kind}{'s' if len(messages) > 1 else ''}"
    head += f", the first {_SHOWN}:" if len(messages) > _SHOWN else ":"
    return [head, *(f"  {message}" for message in messages[:_SHOWN])]


def sizes(photos: Sequence[tuple[int, int]]) -> str:
    """Return the line about the (width, height) of photos."""
    counts = Counter(photos).most_common()
    listed = ", ".join(f"{width} x {height} ({count})" for (width, height), count in counts[:3])
    return f"sizes    {listed}" + (f" and {len(counts) - 3} more" if len(counts) > 3 else "")


def exposures(values: Sequence[float | None]) -> str:
    """Return the line about the exposure values of photos, None where the file does not say."""
    known = [value for value in values if value is not None]
    if not known:
        return "exposure not in the files"
    return f"exposure EV100 {min(known):.2f} to {max(known):.2f} ({len(known)} of {len(values)} photos)"


def encoding_sentences(photos: Sequence[Photo]) -> list[str]:
    """Return a sentence about the photos whose colours cannot be converted, if there are any."""
    names = [photo.image_path.name for photo in photos if photo.encoding == UNREADABLE]
    if not names:
        return []
    return [
        f"{len(names)} of {len(photos)} photos {'is' if len(names) == 1 else 'are'} encoded with an {UNREADABLE}, such "
        f"as {names[0]}; their colours are taken as sRGB and may come out wrong: convert them to sRGB."
    ]


def converted_encodings(encodings: Iterable[str | None]) -> str:
    """Return the photos' encodings that are converted while they are read, each with its number of photos."""
    counts = Counter(encoding for encoding in encodings if encoding not in (None, UNREADABLE))
    return ", ".join(f"{name} ({count})" for name, count in counts.most_common())
