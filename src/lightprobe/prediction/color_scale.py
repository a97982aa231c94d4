"""Confidence as colour: one fixed range for all photos, so that their pictures can be compared.

    confidence = exp(-e),  e = the error to expect of ln radiance,

so that 1 / confidence is the factor that a direction's radiance is probably off by.
"""

import numpy as np

RANGE = (0.3, 0.7)
"""Off by a factor of 3.3, and of 1.4. Nearly all confidences lie between; the others get the colour of the
end.
"""

TICKS = (0.3, 0.4, 0.5, 0.6, 0.7)  # of the legend, confidences

# Dark to bright in even steps (viridis), sRGB: differences still show in grey and to the colour-blind.
_STOPS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")


def confidence_colors(confidence: np.ndarray) -> np.ndarray:
    """Return the sRGB colours (..., 3) float32 in [0, 1] of confidences of any shape."""
    place = (confidence - RANGE[0]) / (RANGE[1] - RANGE[0])
    at = np.linspace(0, 1, len(_STOPS))
    stops = np.array([[int(stop[i : i + 2], 16) / 255 for i in (1, 3, 5)] for stop in _STOPS])
    return np.stack([np.interp(place, at, channel) for channel in stops.T], -1).astype(np.float32)


def css_gradient() -> str:
    """Return the colours from left to right as CSS, which blends them as `confidence_colors` does."""
    return f"linear-gradient(to right, {', '.join(_STOPS)})"


def ticks() -> list[tuple[float, str, str]]:
    """Return (place, confidence, factor of the error to expect) at `TICKS`; places run from 0 to 1, the rest
    is words.

    The first stands for all that is less confident, too.
    """
    span = RANGE[1] - RANGE[0]
    marks = [((tick - RANGE[0]) / span, f"{tick:.1f}", f"×{1 / tick:.2g}") for tick in TICKS]
    place, number, factor = marks[0]
    return [(place, f"≤ {number}", f"≥ {factor}"), *marks[1:]]
