"""Colour encodings that a file declares and that are not applied: ICC profiles and PNG's gamma.

Samples are taken as sRGB. A profile is judged by what it does, not by its name: one that leads a few colours to where
sRGB leads them is sRGB, whoever wrote it.
"""

import functools
import io
from pathlib import Path

import numpy as np
from PIL import Image, ImageCms

from lightprobe.imaging.opening import decode_errors, open_image

_USUAL_GAMMA, _GAMMA_STEP = 1 / 2.2, 0.005  # what PNG asks sRGB files to write
_LARGEST_ERROR = 6  # of 255, in a sample: profiles store rounded curves, and a plain 2.2 is off by more in the darks


def foreign_encoding(path: Path) -> str | None:
    """Return the name of the colour encoding that an image file declares, or None when that is sRGB or not declared.

    Read from the header. Raises `InputError` as `image_size`.
    """
    with decode_errors(path), open_image(path) as image:
        info = image.info
    profile, gamma = info.get("icc_profile"), info.get("gamma")
    if profile:
        return _foreign_profile(profile)
    if gamma is None or "srgb" in info or abs(gamma - _USUAL_GAMMA) <= _GAMMA_STEP:
        return None
    return f"PNG gamma {gamma:.4g}"


@functools.lru_cache(maxsize=64)
def _foreign_profile(data: bytes) -> str | None:
    """Return the name of an ICC profile, or None when it is sRGB."""
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(data))
        name = ImageCms.getProfileDescription(profile).strip() or "without a name"
        space = profile.profile.xcolor_space.strip()
        if space not in ("RGB", "GRAY"):
            return f"ICC profile {name}"
        patches = Image.fromarray(_patches(grey=space == "GRAY"))
        shown = ImageCms.profileToProfile(
            patches, profile, ImageCms.createProfile("sRGB"), ImageCms.Intent.RELATIVE_COLORIMETRIC, outputMode="RGB"
        )
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return "ICC profile that cannot be read"
    difference = np.abs(np.asarray(shown, int) - np.asarray(patches.convert("RGB"), int))
    return None if difference.max() <= _LARGEST_ERROR else f"ICC profile {name}"


def _patches(*, grey: bool) -> np.ndarray:
    """Return colours that tell encodings apart, (1, N) or (1, N, 3) uint8: a ramp, and soft tints within any gamut."""
    ramp = np.arange(0, 256, 17, dtype=np.uint8)
    if grey:
        return ramp[None]
    tints = np.array([[r, g, b] for r in (90, 190) for g in (90, 190) for b in (90, 190)], np.uint8)
    return np.concatenate([np.repeat(ramp[:, None], 3, axis=1), tints])[None]
