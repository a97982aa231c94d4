"""Scores of images, environments and material maps.

Images are compared as sRGB in [0, 1]: composited on white in linear light, then encoded (and so clipped at
the white of the photo). PSNR and SSIM are torchmetrics'; SSIM has the usual 11 x 11 Gaussian window of sigma
1.5, border mirrored. "Masked" means the pixels with more than half coverage in the photo.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.imaging import srgb_encode
from lightprobe.light import cubemap

_WINDOW = 11  # pixels along SSIM's window
_WHOLE, _BAND = 2**20, 2**18  # pixels of images that are compared at once, and of a band of larger ones
BRIGHTEST = 0.01  # share of the sphere whose lights are scored on their own: suns, lamps, windows
_PERFECT_PSNR = 100.0  # dB; stands for infinity, which JSON cannot hold and no mean survives


@dataclass(frozen=True)
class ImageScores:
    """PSNR in dB and SSIM, over the full frame and over the object's pixels."""

    psnr: float
    ssim: float
    psnr_masked: float
    ssim_masked: float

    def to_json(self) -> dict[str, float]:
        """Return the scores by name."""
        return asdict(self)


def on_white(premultiplied: Tensor, coverage: Tensor) -> Tensor:
    """Composite linear premultiplied (H, W, 3) with coverage (H, W) on white and encode to sRGB in [0, 1]."""
    return srgb_encode((premultiplied + (1 - coverage)[..., None]).clamp(0, 1))


def image_scores(image: Tensor, reference: Tensor, mask: Tensor) -> ImageScores:
    """Compare two sRGB images (H, W, 3) in [0, 1]; `mask` (H, W) bool marks the object's pixels."""
    from torchmetrics.functional.image import peak_signal_noise_ratio

    a, b = (x.permute(2, 0, 1)[None].to(torch.float32) for x in (image, reference))
    mean, per_pixel = _ssim(a, b)
    inside = mask.to(per_pixel.device)
    return ImageScores(
        psnr=min(float(peak_signal_noise_ratio(a, b, data_range=1.0)), _PERFECT_PSNR),
        ssim=mean,
        psnr_masked=psnr(image[mask], reference[mask]),
        ssim_masked=float(per_pixel[inside].mean()) if inside.any() else math.nan,
    )


def _ssim(a: Tensor, b: Tensor) -> tuple[float, Tensor]:
    """Return the mean SSIM of (1, 3, H, W) images and its map (H, W), the mean over channels.

    Large images are compared in bands of rows. NaN for strips narrower than half of the window.
    """
    height, width, rim = *a.shape[2:], _WINDOW // 2
    if min(height, width) <= rim:
        return math.nan, a.new_full((height, width), math.nan)
    if height * width <= _WHOLE:
        return _ssim_of(a, b)
    full, step = a.new_empty(height, width), max(1, _BAND // width)
    for top in range(0, height, step):
        bottom = min(top + step, height)
        first, last = max(0, top - rim), min(height, bottom + rim)
        part = _ssim_of(a[:, :, first:last], b[:, :, first:last])[1]
        full[top:bottom] = part[top - first : bottom - first]
    return float(full.double().mean()), full


def _ssim_of(a: Tensor, b: Tensor) -> tuple[float, Tensor]:
    from torchmetrics.functional.image import structural_similarity_index_measure

    mean, full = structural_similarity_index_measure(a, b, data_range=1.0, return_full_image=True)
    return float(mean), full[0].mean(0)


def psnr(values: Tensor, reference: Tensor) -> float:
    """Return the PSNR in dB of values in [0, 1] of any shape; nan when there are none."""
    if values.numel() == 0:
        return math.nan
    error = float(((values - reference).double() ** 2).mean())
    return _PERFECT_PSNR if error <= 10 ** (-_PERFECT_PSNR / 10) else -10 * math.log10(error)


def channel_scale(values: Tensor, reference: Tensor) -> Tensor:
    """Return the factors (C,) that bring linear `values` (N, C) closest to `reference` once displayed.

    Light times c and albedo over c look alike; scores after this scale leave that freedom out. Closest means
    the least squared error of the clipped sRGB values, as in the scores: a fit to linear values would follow
    a few highlights far above white. Factors from 1/16 to 16 are searched, first on a grid, then by
    bisection.
    """
    channels = zip(values.unbind(1), reference.unbind(1), strict=True)
    return torch.stack([_best_factor(v, r) for v, r in channels])


def _best_factor(values: Tensor, reference: Tensor) -> Tensor:
    target = srgb_encode(reference.double().clamp(0, 1))

    def error(exponent: float) -> float:
        return float((srgb_encode((values.double() * 2**exponent).clamp(0, 1)) - target).square().sum())

    best, step = min(np.arange(-4, 4.5, 0.5).tolist(), key=error), 0.5
    while step > 1e-4:
        step /= 2
        best = min((best - step, best, best + step), key=error)
    return values.new_tensor(2**best)


def log_difference(environment: Tensor, truth: Tensor) -> Tensor:
    """Return ln E - ln T (6, R, R, 3) of two cubemaps of linear radiance.

    A floor of 1 % of the true mean radiance keeps black texels from deciding a score.
    """
    solid = cubemap.solid_angles(truth.shape[1]).to(truth)
    floor = 0.01 * float((solid[..., None] * truth).sum() / (3 * solid.sum()))
    return torch.log(environment.clamp_min(0) + floor) - torch.log(truth.clamp_min(0) + floor)


def aligned(difference: Tensor, *, per_channel: bool = False) -> Tensor:
    """Return a log difference (6, R, R, 3) less its mean by solid angle, over all or `per_channel`.

    What is left is what one factor, or one for each channel, cannot mend.
    """
    share = cubemap.solid_angles(difference.shape[1]).to(difference)[..., None] / (4 * math.pi)
    mean = (share * difference).sum((0, 1, 2))
    return difference - (mean if per_channel else mean.mean())


def environment_log_rmse(difference: Tensor, weight: Tensor | None = None) -> float:
    """Return the root mean square of a log difference (6, R, R, 3) by solid angle.

    `weight` (6, R, R), such as a confidence, multiplies the solid angle.
    """
    solid = cubemap.solid_angles(difference.shape[1]).to(difference)
    share = solid if weight is None else solid * weight.to(solid)
    return math.sqrt(float((share[..., None] * difference**2).sum() / (3 * share.sum().clamp_min(1e-12))))


def brightest(truth: Tensor) -> Tensor:
    """Return the texels (6, R, R) bool of highest radiance that fill 1 % of the sphere, at least one."""
    solid = cubemap.solid_angles(truth.shape[1]).to(truth).reshape(-1)
    order = torch.argsort(truth.mean(-1).reshape(-1), descending=True, stable=True)
    before = solid[order].cumsum(0) - solid[order]
    chosen = torch.zeros_like(solid, dtype=torch.bool)
    chosen[order[before < BRIGHTEST * 4 * math.pi]] = True
    return chosen.reshape(truth.shape[:3])


def interval(values: Sequence[float], groups: Sequence[str] | None = None) -> float:
    """Return half the width of the 95 % interval of the mean of `values` by Student's t, or nan.

    It is nan for fewer than two groups. Values of one group, such as photos under one environment, are no
    independent evidence: the group is the unit. With G groups g of n_g values, N in all, about the mean m of
    all values,

        s^2 = G / (G - 1) sum_g (n_g (m_g - m) / N)^2,    half width = t(.975, G - 1) s.

    With equally large groups this is the t interval of the groups' means; without `groups` each value is one.
    """
    gathered: dict[str, list[float]] = {}
    for place, value in enumerate(values):
        gathered.setdefault(str(place) if groups is None else groups[place], []).append(value)
    count = len(gathered)
    if count < 2:
        return math.nan
    mean = float(np.mean(values))
    shares = [sum(value - mean for value in group) / len(values) for group in gathered.values()]
    standard_error = math.sqrt(count / (count - 1) * sum(share * share for share in shares))
    return float(scipy.stats.t.ppf(0.975, count - 1)) * standard_error


def photo_interval(values: Mapping[str, float], lights: Mapping[str, str]) -> float:
    """Return `interval` of values by photo, where photos under one of the named lights are one group."""
    groups = [f"light {lights[photo]}" if photo in lights else f"photo {photo}" for photo in values]
    return interval(list(values.values()), groups)


def mean_angle(normals: np.ndarray, reference: np.ndarray) -> float:
    """Return the mean angle in degrees between two sets of vectors (N, 3), which need not be unit."""
    a = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    b = reference / np.linalg.norm(reference, axis=1, keepdims=True)
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(1))).mean())
