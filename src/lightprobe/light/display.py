"""Maps of light for the eye: exposed, tone-mapped, and as PNG in memory."""

import io

import numpy as np
from PIL import Image

from lightprobe.imaging import LUMA, srgb_encode


def exposure(image: np.ndarray) -> float:
    """Return the factor that shows a linear HDR image (H, W, 3) at a middling brightness, suns or not.

    Most of it may be black. 1 for an image that is black all over.
    """
    luma = image @ LUMA
    bright = luma[luma > 0]
    typical = float(np.minimum(luma, 5 * np.median(bright)).mean()) if bright.size else 0.0
    return 0.5 / typical if typical > 0 else 1.0


def tone_mapped(image: np.ndarray, factor: float) -> np.ndarray:
    """Return linear display values in [0, 1): 1 - exp(-factor * radiance), highlights bent, not cut."""
    return 1 - np.exp(-factor * np.maximum(image, 0))


def displayed(image: np.ndarray) -> np.ndarray:
    """Return a linear HDR image (H, W, 3) exposed and tone-mapped, sRGB in [0, 1]."""
    return srgb_encode(tone_mapped(image, exposure(image)))


def png(encoded: np.ndarray) -> bytes:
    """Return the PNG file of a picture (H, W, 3) that is display-encoded in [0, 1]."""
    buffer = io.BytesIO()
    Image.fromarray((np.clip(encoded, 0, 1) * 255 + 0.5).astype(np.uint8)).save(buffer, "PNG")
    return buffer.getvalue()
