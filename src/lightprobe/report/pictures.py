"""Small pictures for the report, encoded in memory."""

import base64
import io

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from lightprobe.evaluation.evaluation import ViewResult
from lightprobe.evaluation.three_spheres import ThreeSpheres
from lightprobe.imaging import read_hdr, shrink_area, srgb_encode
from lightprobe.light.display import exposure, tone_mapped
from lightprobe.light.environment import Environment
from lightprobe.light.files import plane
from lightprobe.prediction.confidence import RANGE, confidence_colors

_SIDE = 256  # pixels of a picture that explains
_LARGE = 384  # and of those that lead a page
_DIFFERENCE_GAIN = 3  # shows errors of a few percent

_DIFFERENCE = f"difference ×{_DIFFERENCE_GAIN}"
CONFIDENCE = "confidence"
PICTURE_NOTES = {
    "photo": "the test photo on white, cut to the object",
    "render": "the object under the light predicted from this very photo",
    _DIFFERENCE: f"photo against render, |a - b| of the sRGB values times {_DIFFERENCE_GAIN}: black where they are "
    f"equal, a channel at its brightest where it is off by 1/{_DIFFERENCE_GAIN} of its range or more",
    "base colour": "of the object, sRGB",
    "roughness": "black 0, perfectly smooth; white 1",
    "metallic": "black 0, no metal; white 1, metal",
    "normal": "x, y, z of the unit normal in the scene as red, green, blue: -1 is black, 0 middle grey, 1 full",
    "predicted light": "the environment map in all directions, tone-mapped: highlights are bent, not cut; its EXR has "
    "the linear radiance",
    "true light": "the true map; both are shown at the exposure that suits this one",
    CONFIDENCE: "exp(-the error to expect of ln radiance), direction by direction: .5 says that the radiance is "
    f"probably off by a factor of 2, as 1/.5 = 2. The colours run from {RANGE[0]} or less to {RANGE[1]}, for all "
    "photos alike",
    "spheres, predicted light": "a diffuse, a rough reflecting and a mirror sphere in the object's place",
    "spheres, true light": "the same under the true light",
}
"""What each picture shows and how it is to be read, by title."""

OF_THE_VIEW = ("photo", "render")
OF_THE_LIGHT = ("predicted light", "spheres, predicted light", "true light", "spheres, true light")
FOLDED = tuple(title for title in PICTURE_NOTES if title not in (*OF_THE_VIEW, *OF_THE_LIGHT))
"""The pictures that lead, beside each other in two columns, and those that explain them."""

PICTURE_HINTS = {
    _DIFFERENCE: f"black: equal; brightest: off by 1/{_DIFFERENCE_GAIN} or more",
    CONFIDENCE: "×2: the radiance is probably off by a factor of two",
}
"""The same in a few words, for those pictures that mislead without."""


def data_uri(encoded: np.ndarray, *, side: int = _SIDE) -> str:
    """Return a picture (H, W, 3) or (H, W), already display-encoded in [0, 1], as the data URI of a small
    JPEG.
    """
    values = encoded if encoded.ndim == 3 else np.repeat(encoded[..., None], 3, axis=2)
    small = shrink_area(np.ascontiguousarray(values, np.float32), side)
    buffer = io.BytesIO()
    Image.fromarray((np.clip(small, 0, 1) * 255 + 0.5).astype(np.uint8)).save(buffer, "JPEG", quality=88)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def view_pictures(result: ViewResult) -> dict[str, str]:
    """Return the report's pictures of one test photo by title, as data URIs."""
    view = result.view
    photo, render = (image.cpu().numpy() for image in (view.reference, result.image))
    pictures = {
        "photo": photo,
        "render": render,
        _DIFFERENCE: np.abs(photo - render) * _DIFFERENCE_GAIN,
        **_material_pictures(result),
    }
    mask = view.mask.cpu().numpy()
    pictures = {title: _cut(picture, mask) for title, picture in pictures.items()}
    pictures |= {**_light_pictures(result), **_sphere_pictures(result)}
    sides = {title: _SIDE if title in FOLDED else _LARGE for title in pictures}
    return {title: data_uri(picture, side=sides[title]) for title, picture in pictures.items()}


def _cut(picture: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the part around the object of a picture (h, w, 3) of the view, whose mask (H, W) may be larger."""
    pairs = zip(object_box(mask), mask.shape, picture.shape, strict=False)
    rows, columns = (
        slice(part.start * small // full, -(-part.stop * small // full)) for part, full, small in pairs
    )
    return picture[rows, columns]


def object_box(mask: np.ndarray) -> tuple[slice, slice]:
    """Return the rows and columns around the object of a mask (H, W) bool, with a margin; all when it is
    empty.
    """
    slices = []
    for axis in (1, 0):
        used = np.nonzero(mask.any(axis=axis))[0]
        first, last = (int(used[0]), int(used[-1]) + 1) if len(used) else (0, mask.shape[1 - axis])
        margin = max(2, (last - first) // 12)
        slices.append(slice(max(0, first - margin), last + margin))
    return slices[0], slices[1]


def _material_pictures(result: ViewResult) -> dict[str, np.ndarray]:
    g = result.view.gbuffer
    return {
        "base colour": _on_white(result, srgb_encode(g.base_color.clamp(0, 1))),
        "roughness": _on_white(result, g.roughness[:, None].expand(-1, 3)),
        "metallic": _on_white(result, g.metallic[:, None].expand(-1, 3)),
        "normal": _on_white(result, 0.5 + 0.5 * g.normal),
    }


def _on_white(result: ViewResult, values: Tensor) -> np.ndarray:
    g = result.view.gbuffer
    frame = torch.ones(g.height * g.width, 3, device=values.device)
    frame[g.pixel] = values
    return frame.reshape(g.height, g.width, 3).cpu().numpy()


def _light_pictures(result: ViewResult) -> dict[str, np.ndarray]:
    """The predicted light, the true one at the same exposure when it is known, and the confidence in colours."""
    predicted = result.prediction.environment.panorama()
    truth = result.view.photo.truth.environment
    lights = {"predicted light": predicted}
    if truth is not None:
        environment = result.prediction.environment
        lights["true light"] = Environment.load(truth, environment.device).panorama()
    factor = exposure(list(lights.values())[-1])
    pictures = {title: srgb_encode(tone_mapped(image, factor)) for title, image in lights.items()}
    return pictures | {CONFIDENCE: confidence_colors(plane(result.prediction.confidence))}


def _sphere_pictures(result: ViewResult) -> dict[str, np.ndarray]:
    """The three spheres under the predicted light and, where that is known, under the true one."""
    truth = result.view.photo.truth.environment
    lights = {"spheres, predicted light": result.prediction.environment.panorama()}
    if truth is not None:
        lights["spheres, true light"] = np.ascontiguousarray(read_hdr(truth)[..., :3], np.float32)
    spheres, side = _spheres(result), _LARGE // 3
    return {title: spheres.picture(torch.from_numpy(light), side).numpy() for title, light in lights.items()}


def _spheres(result: ViewResult) -> ThreeSpheres:
    """Return the spheres of the scores; without a true light they are seen along the camera's axis."""
    if result.true_light is not None:
        return result.true_light.spheres
    axes = torch.from_numpy(result.view.camera.camera_to_world[:3, :3].copy())
    return ThreeSpheres(axes[:, 2], axes[:, 1])
