"""What is said of photos whose colours are encoded in another way than sRGB, which they are taken for."""

from collections.abc import Sequence

from lightprobe.scene.photo import Photo


def encoding_sentences(photos: Sequence[Photo]) -> list[str]:
    """Return a sentence for every foreign colour encoding among the photos, the most frequent first."""
    by_encoding: dict[str, list[str]] = {}
    for photo in photos:
        if photo.encoding is not None:
            by_encoding.setdefault(photo.encoding, []).append(photo.image_path.name)
    return [
        f"{len(names)} of {len(photos)} photos {'is' if len(names) == 1 else 'are'} encoded with the {encoding}, such "
        f"as {names[0]}; it is not applied, and their colours are taken as sRGB and come out wrong: convert to sRGB."
        for encoding, names in sorted(by_encoding.items(), key=lambda item: -len(item[1]))
    ]
