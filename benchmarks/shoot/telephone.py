"""The telephone: its lens, and what it makes of the radiance that arrives: exposure, noise, tones, a JPEG with EXIF.

Notation: x right and y down in pixels from the centre over the focal length; the lens takes the undistorted radius
r to r (1 + k1 r^2), as OpenCV does.
"""

import io
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from demo_scene.files import srgb_encode
from demo_scene.lights import luminance
from demo_scene.noise import smoothstep

_FILM_DIAGONAL = 43.27  # mm; an equivalent focal length stands for an angle over the diagonal
_KEY = 0.16  # what the exposure makes of the picture's middle
_EXIF, _TIME, _F_NUMBER, _ISO, _TAKEN, _FOCAL, _FOCAL_35 = (
    0x8769,
    0x829A,
    0x829D,
    0x8827,
    0x9003,
    0x920A,
    0xA405,
)
_MAKE, _MODEL, _DATE = 0x010F, 0x0110, 0x0132


@dataclass(frozen=True)
class Telephone:
    """A camera for a whole shoot; its pictures are `width` x `height` pixels."""

    width: int
    height: int
    film: int  # equivalent focal length in mm of 35 mm film
    k1: float
    contrast: float  # of the tone curve, 0 to 1
    grain: float  # deviation of the noise at white, of one photo at base sensitivity

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.film / _FILM_DIAGONAL * float(np.hypot(self.width, self.height))

    def rays(self, pose: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return unit world directions (H * W, 3) through points offset (H * W, 2) in [0, 1)^2 of every pixel."""
        x, y = np.meshgrid(np.arange(self.width), np.arange(self.height))
        seen = np.stack([x.ravel(), y.ravel()], axis=1) + offset - [self.width / 2, self.height / 2]
        seen = seen / self.focal
        straight = seen
        for _ in range(8):  # the inverse of the lens has no simple formula
            straight = seen / (1 + self.k1 * (straight**2).sum(axis=1, keepdims=True))
        local = np.column_stack([straight[:, 0], -straight[:, 1], -np.ones(len(seen))])
        return local @ pose[:3, :3].T / np.linalg.norm(local, axis=1, keepdims=True)

    def exposure(self, picture: np.ndarray, rng: np.random.Generator) -> float:
        """Return the factor for a picture (H, W, 3) that the automatic exposure takes; it wavers by a third stop."""
        h, w = self.height, self.width
        bright = luminance(picture[h // 6 : -h // 6, w // 6 : -w // 6]).ravel()
        middle = np.exp(np.log(bright + 1e-4 * bright.mean() + 1e-12).mean())
        return float(min(_KEY / middle, 2.0 / np.quantile(bright, 0.9)) * np.exp2(rng.uniform(-0.3, 0.3)))

    def develop(self, linear: np.ndarray, exposure: float, rng: np.random.Generator) -> np.ndarray:
        """Return the 8-bit picture of exposed and balanced radiance (H, W, 3), where 1 is white."""
        noise = self.grain * np.sqrt(np.clip(linear, 0, 1) + 0.01) * min(max(exposure, 0.5), 3.0) ** 0.25
        grainy = linear + noise * gaussian_filter(rng.normal(size=linear.shape), (0.5, 0.5, 0)) * 1.6
        shown = srgb_encode(np.where(grainy < 0.8, grainy, 1 - 0.2 * np.exp(-(grainy - 0.8) / 0.2)))
        shown = shown + self.contrast * (smoothstep(0.0, 1.0, shown) - shown)
        return (np.clip(shown, 0, 1) * 255 + 0.5).astype(np.uint8)

    def jpeg(self, shown: np.ndarray, exposure: float, taken: datetime) -> bytes:
        """Return the file of an 8-bit picture."""
        exif, date = Image.Exif(), taken.strftime("%Y:%m:%d %H:%M:%S")
        exif[_MAKE], exif[_MODEL], exif[_DATE] = "Simulated", "Telephone", date
        iso = 50 if exposure < 1 else 200
        seconds = min(max(exposure, 1e-3), 30.0) / iso
        exif.get_ifd(_EXIF).update(
            {
                _TIME: seconds,
                _F_NUMBER: 1.8,
                _ISO: iso,
                _TAKEN: date,
                _FOCAL: self.film / 5.4,
                _FOCAL_35: self.film,
            }
        )
        file = io.BytesIO()
        Image.fromarray(shown).save(file, "JPEG", quality=91, exif=exif)
        return file.getvalue()


def white_balance(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the factors (3,) by which a telephone takes most of a light's colour (3,) out, not quite rightly."""
    balance = (luminance(light) / light) ** 0.7 * np.exp2(rng.normal(0, [0.05, 0.02, 0.06]))
    return balance / luminance(balance)
