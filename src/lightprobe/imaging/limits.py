"""The size an image header may announce before anything is decoded."""

from pathlib import Path

from lightprobe.core.errors import InputError

MAX_PIXELS = 134_217_728  # 2^27, a 16384 x 8192 environment: 1.6 GB as float32 RGB


def check_pixels(path: Path, width: int, height: int) -> None:
    """Raise `InputError` when the header of `path` announces an empty or an absurdly large image."""
    if min(width, height) < 1:
        raise InputError(f"{path} has no pixels ({width} x {height}).")
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path} announces {width} x {height} pixels, more than the {MAX_PIXELS / 1e6:.0f} million this program "
            "decodes; scale the image down."
        )
