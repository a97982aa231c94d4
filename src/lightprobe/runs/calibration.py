"""Finding a run's calibration (`models.calibration`) from something known: a light, an albedo, or a meter's reading.

All three are told by one photo. With g the factor of light per channel:

    known light     the object under the map, base colours over g, has to look like the photo: g is the median over
                    pixels of render / photo; a least-squares factor would dim what does not match
    known albedo    of a point on the object: g = the run's base colour there / the albedo. Of a card beside it, of
                    albedo a and pixel value p: g = pi p / (a E), E the irradiance that the run predicts on the card
    light meter     g = lux / (K E), E the predicted irradiance on a surface that faces up, by luminance, K the cd/m^2
                    of a unit of the photo (EXIF); one number for all channels
"""

import math
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.failures import writing
from lightprobe.core.files import remove
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import relight
from lightprobe.export.light_file import candela_per_unit
from lightprobe.imaging import LUMA
from lightprobe.jobs.files import BY_NAME
from lightprobe.jobs.light_files import whole_light
from lightprobe.jobs.photos import NewPhoto, known_photo, read_photo
from lightprobe.jobs.request import PredictRequest
from lightprobe.jobs.session import load_locator
from lightprobe.light import cubemap
from lightprobe.light.photometry import USUAL_MEAN, tone_map
from lightprobe.models import Decomposition
from lightprobe.models.calibration import Calibration, is_plausible
from lightprobe.prediction import Predictor
from lightprobe.render.asset import rasterize_asset
from lightprobe.scene.camera import Camera

_ROUNDS = 3  # of a factor that also changes what the object reflects onto itself
_OPAQUE = 0.9  # coverage from which a pixel shows the object alone
_PATCH = 0.01  # of the photo's longer side: half the edge of the square of pixels around a point
_DARK = 1e-3  # linear value below which a ratio says nothing
_MOST = 2**20  # pixels of the object in a photo, about: larger photos are reduced
# Three test photos each of chair and robot: .58 to .92 under their own lights, but for one of -.25 whose
# factors are off in colour; of 18 under others' 14 below.
_LITTLE = 0.4  # share of a photo's contrast below which a known light is hardly its own
_FEWEST = 16  # pixels that a light is compared on
_UP = torch.tensor([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Point:
    """A point of a photo whose albedo is known."""

    x: float  # pixels from the left
    y: float  # from the top
    albedo: tuple[float, float, float]  # linear RGB


def calibrate_by_light(
    run: Path,
    photo: Path,
    environment: Path,
    *,
    camera: Path | None = None,
    mask: Path | None = None,
    device: str | torch.device = "auto",
) -> Calibration:
    """Find and store a run's calibration by a photo under a known light, a map in the photo's exposure.

    Raises `InputError` for files that cannot be used, and when the light cannot be this photo's; warns when
    it may be another one's.
    """
    opened = _Opened.of(run, photo, camera, mask, device)
    light = whole_light(environment, opened.device)
    factor, decomposition, pixels = torch.ones(3), opened.decomposition, opened.photo.pixels
    for _ in range(_ROUNDS):
        asset = Calibration(_rgb(factor), "").applied(decomposition.asset)
        image, cover = relight(replace(decomposition, asset=asset), light, opened.photo.pixel_camera)
        inside = (cover.cpu() > _OPAQUE) & (torch.from_numpy(pixels.alpha) > _OPAQUE)
        whole = inside & ~torch.from_numpy(pixels.clipped).any(-1)
        if int(whole.sum()) < _FEWEST:
            raise InputError(
                f"{photo} shows too little of the object that is not clipped; expose it for the object."
            )
        factor = factor * _median_ratio(image.cpu()[whole], torch.from_numpy(pixels.color)[whole])
    found = _stored(opened.run, factor, f"{photo.name} under {environment.name}")
    explained = _explained(image.cpu()[whole], torch.from_numpy(pixels.color)[whole])
    if explained < _LITTLE:
        warnings.warn(
            f"The object under {environment.name} explains only {100 * max(explained, 0):.0f} % of what {photo.name} "
            "shows of it, so this calibration is doubtful: are light and camera this photo's own?",
            LightprobeWarning,
            stacklevel=2,
        )
    return found


def _explained(render: Tensor, photo: Tensor) -> float:
    """Return which share of the photo's contrast a render explains, at most 1, colours (N, 3) linear,
    tone-mapped.

    Either after one factor per channel, as it is that factor which is sought.
    """
    shown, seen = (tone_map(color * USUAL_MEAN / color.mean(0).clamp(min=1e-9)) for color in (render, photo))
    return 1 - float((shown - seen).square().mean() / (seen - seen.mean(0)).square().mean().clamp(min=1e-9))


def calibrate_by_albedo(
    run: Path,
    photo: Path,
    point: Point,
    *,
    camera: Path | None = None,
    mask: Path | None = None,
    up: bool = False,
    device: str | torch.device = "auto",
) -> Calibration:
    """Find and store a run's calibration by a point of a photo: on the object, or on a card beside it.

    up: whether the card lies flat and faces up; else it faces the camera. Raises `InputError` as
    `calibrate_by_light`.
    """
    opened = _Opened.of(run, photo, camera, mask, device)
    alpha = opened.photo.pixels.alpha
    albedo, decomposition = torch.tensor(point.albedo), opened.decomposition
    (x, y), patch = _patch(opened.photo.camera, alpha.shape, point)
    camera_there = opened.photo.pixel_camera.normalised(decomposition.similarity)
    gbuffer = rasterize_asset(decomposition.asset, camera_there, opened.device)
    chosen = torch.from_numpy(np.isin(gbuffer.pixel.cpu().numpy(), np.flatnonzero(patch)))
    # A card may stand beside the object, closer than a patch is wide, or in front of it, where the mask
    # leaves it out.
    cover = alpha[min(int(y), len(alpha) - 1), min(int(x), alpha.shape[1] - 1)]
    if 1 - _OPAQUE < cover < _OPAQUE or (cover >= _OPAQUE and not bool(chosen.any())):
        raise InputError(
            f"--at {point.x:g},{point.y:g} is on the object's outline in {photo}, or where the reconstructed object "
            "has a gap; choose another point."
        )
    if cover >= _OPAQUE:
        color = gbuffer.base_color.cpu()[chosen].median(0).values
        return _stored(opened.run, color / albedo, f"the object's albedo in {photo.name}")
    around = opened.photo.with_background()
    rows, columns = (np.arange(n) * m // n for n, m in zip(around.shape, alpha.shape, strict=False))
    _, patch = _patch(opened.photo.camera, around.shape[:2], point)
    beside = patch & (alpha[rows][:, columns] <= 1 - _OPAQUE)
    value = torch.from_numpy(np.median(around[beside], axis=0)).float()
    if bool((value >= 0.98).any()) or bool((value <= 0).any()):
        raise InputError(
            f"The pixels of {photo} at {point.x:g},{point.y:g} are black or clipped; expose for the card."
        )
    towards_camera = torch.from_numpy(opened.photo.camera.camera_to_world[:3, 2].copy()).float()
    received = _irradiance(opened.predicted(), _UP if up else towards_camera)
    return _stored(opened.run, math.pi * value / (albedo * received), f"a card in {photo.name}")


def calibrate_by_meter(
    run: Path,
    photo: Path,
    lux: float,
    *,
    camera: Path | None = None,
    mask: Path | None = None,
    device: str | torch.device = "auto",
) -> Calibration:
    """Find and store a run's calibration by a light meter's reading beside the object, its sensor facing up.

    Raises `InputError` as `calibrate_by_light`, and for a photo whose EXIF does not tell its exposure.
    """
    if not (math.isfinite(lux) and lux > 0):
        raise ConfigError(f"--lux must be above 0, not {lux}.")
    opened = _Opened.of(run, photo, camera, mask, device)
    unit = candela_per_unit(opened.photo.ev100)
    if unit is None:
        raise InputError(
            f"{photo} does not tell its exposure (time, f-number and ISO in EXIF), which a meter's reading needs; "
            "calibrate with a grey card (--albedo) instead."
        )
    received = float(_irradiance(opened.predicted(), _UP) @ torch.from_numpy(LUMA))
    return _stored(opened.run, torch.full((3,), lux / (unit * received)), f"{lux:g} lux beside {photo.name}")


def reset_calibration(run_folder: Path) -> bool:
    """Forget a run's calibration; return whether there was one."""
    run = RunFolder.open(run_folder)
    with writing(run):
        there = run.calibration_file.exists()
        remove(run.calibration_file)
    return there


@dataclass(frozen=True)
class _Opened:
    """A run before any calibration, and a photo of its object."""

    run: RunFolder
    photo: NewPhoto
    decomposition: Decomposition
    device: torch.device

    @staticmethod
    def of(
        folder: Path, image: Path, camera: Path | None, mask: Path | None, device: str | torch.device
    ) -> "_Opened":
        run, where = RunFolder.open(folder), resolve_device(device)
        decomposition = Decomposition.load(run, where, calibrated=False)
        request = PredictRequest(photo=image, camera=camera, mask=mask, background=False)
        photo = read_photo(
            request,
            known_photo(run, request),
            BY_NAME.location_of(run.path / "predictions", image),
            lambda: load_locator(run, Predictor(decomposition, device=where)),
            _MOST,
        )
        return _Opened(run, photo, decomposition, where)

    def predicted(self) -> Tensor:
        """Return the light (6, R, R, 3) that the run finds in the photo, before any calibration."""
        found = Predictor.load(self.run.path, self.device).predict(self.photo.pixels, self.photo.pixel_camera)
        light = found.environment.texels.cpu()
        return light if found.calibration is None else light / found.calibration.tensor()


def _patch(whole: Camera, shape: tuple[int, ...], point: Point) -> tuple[tuple[float, float], np.ndarray]:
    """Return a point's x and y in pixels of a reduced photo (H, W), and the pixels (H, W) bool around the point.

    whole: the camera of the photo at its own size, which the point is given in. Raises `ConfigError` when the
    point is not in the photo.
    """
    height, width = shape
    if not (0 <= point.x < whole.width and 0 <= point.y < whole.height):
        raise ConfigError(
            f"--at {point.x:g},{point.y:g} is outside of the photo, which is {whole.width} x {whole.height} pixels."
        )
    x, y = point.x * width / whole.width, point.y * height / whole.height
    reach = max(1.0, _PATCH * max(height, width))
    near = np.abs(np.arange(height) + 0.5 - y) <= reach, np.abs(np.arange(width) + 0.5 - x) <= reach
    return (x, y), near[0][:, None] & near[1]


def _median_ratio(render: Tensor, photo: Tensor) -> Tensor:
    """Return the median (3,) of render / photo over pixels (N, 3), where neither is black."""
    usable = (torch.minimum(render, photo) > _DARK).all(-1)
    if int(usable.sum()) < _FEWEST:
        raise InputError(
            "Under this light the object is black where the photo is not; give the photo's own light."
        )
    return (render[usable] / photo[usable]).median(0).values.float()


def _irradiance(light: Tensor, normal: Tensor) -> Tensor:
    """Return the irradiance (3,) of a surface with a unit normal (3,) under a light (6, R, R, 3)."""
    resolution = light.shape[1]
    cosine = (cubemap.directions(resolution) @ normal).clamp(min=0) * cubemap.solid_angles(resolution)
    return (light * cosine[..., None]).sum((0, 1, 2))


def _rgb(factor: Tensor) -> tuple[float, float, float]:
    r, g, b = factor.tolist()
    return r, g, b


def _stored(run: RunFolder, factor: Tensor, source: str) -> Calibration:
    """Write and return the calibration; raise `InputError` when no run could be off by so much."""
    if not is_plausible(factor.tolist()):
        numbers = ", ".join(f"{value:.3g}" for value in factor.tolist())
        raise InputError(
            f"The run's brightness would be off by {numbers}, which cannot be: check the photo, its camera and what is "
            "known of it, and that the light is in the photo's exposure."
        )
    found = Calibration(_rgb(factor), source)
    with writing(run):
        found.save(run.calibration_file)
    return found
