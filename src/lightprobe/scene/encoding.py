"""What is said of photos whose colours are encoded in another way than sRGB."""

from collections import Counter
from collections.abc import Sequence

from lightprobe.imaging import UNREADABLE
from lightprobe.scene.photo import Photo


def encoding_sentences(photos: Sequence[Photo]) -> list[str]:
    """Return a sentence about the photos whose colours cannot be converted, if there are any."""
    names = [photo.image_path.name for photo in photos if photo.encoding == UNREADABLE]
    if not names:
        return []
    return [
        f"{len(names)} of {len(photos)} photos {'is' if len(names) == 1 else 'are'} encoded with an {UNREADABLE}, such "
        f"as {names[0]}; their colours are taken as sRGB and may come out wrong: convert them to sRGB."
    ]


def converted_encodings(photos: Sequence[Photo]) -> str:
    """Return the encodings that are converted while photos are read, with how many, the most frequent first."""
    counts = Counter(photo.encoding for photo in photos if photo.encoding not in (None, UNREADABLE))
    return ", ".join(f"{name} ({count})" for name, count in counts.most_common())
