"""Between a photo's own pixels, which its lens bends, and the pinhole's picture in which masks are found.

The pinhole is the one that a scene's reader resamples the photo to (`scene.distortion`): a mask that is found in its
picture and written in the photo's pixels comes back, when the scene is read, to where it was found.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import resize_area
from lightprobe.imaging.resize import STRIP
from lightprobe.preparation.features import opencv_library
from lightprobe.scene.camera import Camera
from lightprobe.scene.distortion import Resampling, between_knots, knots, with_lens
from lightprobe.scene.lens import Lens

_KNOT = (
    8  # pixels of a small picture between places that the lens is undone for; between them the error is .001
)


def through_lens(camera: Camera, k: float) -> Camera:
    """Return the camera of a photo as its lens took it: its own focal length, and a lens that bends by `k`."""
    return replace(camera, lens=Lens((k,))) if k else camera


def pinhole_camera(camera: Camera, k: float, name: str) -> Camera:
    """Return the pinhole camera, with its lens, that a photo is resampled to when its scene is read.

    Raises `InputError` naming the photo where `k` folds its picture over.
    """
    try:
        return with_lens(camera, Lens((k,)), source=name)
    except InputError as error:
        raise InputError(
            f"The lens that was found for the photo {name} folds its picture over, as no lens does; undistort the "
            "photos first, or prepare those of each lens by themselves."
        ) from error


def undistorted(picture: np.ndarray, camera: Camera) -> np.ndarray:
    """Return a picture (h, w) or (h, w, 3) of a photo as its pinhole shows it; what the lens did not see is 0."""
    if camera.lens is None:
        return picture
    cv2 = opencv_library()
    places, shown = Resampling(camera).places(0, camera.height)
    at = places - np.float32(0.5)
    found = cv2.remap(picture, at, None, cv2.INTER_CUBIC if picture.ndim == 3 else cv2.INTER_LINEAR)
    found[~shown] = 0
    return found


def small_mask(mask: np.ndarray, camera: Camera) -> np.ndarray:
    """Return a mask (H, W) of a photo's own pixels as its small picture's pinhole shows it, (h, w) bool."""
    small = resize_area(mask.astype(np.float32), camera.height, camera.width)
    return undistorted(small, camera) >= 0.5


def pinhole_place(at: tuple[float, float], camera: Camera) -> tuple[float, float]:
    """Return where a pinhole's picture shows what its photo shows at a place; both in shares of width and height."""
    if camera.lens is None:
        return at
    place = _pinhole_points(np.array([at[0] * camera.width, at[1] * camera.height]), camera)
    x, y = np.clip(np.nan_to_num(place) / (camera.width, camera.height), 0, 1)
    return float(x), float(y)


def photo_mask(mask: np.ndarray, camera: Camera, height: int, width: int) -> np.ndarray:
    """Return a mask (h, w) bool of a pinhole's picture in its photo's own pixels, (H, W) float32.

    camera: of the picture. Outlines are smooth where the mask grows.
    """
    cv2, grows = opencv_library(), height > mask.shape[0]
    values = mask.astype(np.float32)
    if not grows and camera.lens is None:
        return resize_area(values, height, width)
    if grows:
        values = cv2.GaussianBlur(values, (0, 0), 0.7)  # as wide as a pixel: it rounds the steps
    way = cv2.INTER_CUBIC if grows else cv2.INTER_LINEAR
    result = np.empty((height, width), np.float32)
    if camera.lens is None:
        cv2.resize(values, (width, height), result, interpolation=way)
    else:
        for top, at in _places(camera, height, width):
            result[top : top + len(at)] = cv2.remap(values, at, None, way, borderMode=cv2.BORDER_REPLICATE)
    if grows:
        result = (result - 0.5) * (height / mask.shape[0]) + 0.5
    return np.clip(result, 0, 1, out=result)


def replaced(fine: np.ndarray, mask: np.ndarray, changed: np.ndarray, camera: Camera) -> np.ndarray:
    """Return a photo's mask (H, W) float32 that is as `fine` (H, W) but where the small `mask` (h, w) `changed` (h, w).

    camera: of the pinhole's picture that the small ones, bool both, belong to.
    """
    size = fine.shape[0], fine.shape[1]
    return np.where(photo_mask(changed, camera, *size) > 0, photo_mask(mask, camera, *size), fine)


def _pinhole_points(points: np.ndarray, camera: Camera) -> np.ndarray:
    """Return where a pinhole shows what its photo shows at `points` (..., 2), pixels; NaN for nowhere."""
    if camera.lens is None:
        raise ValueError("The camera has no lens.")
    focal, center = np.array([camera.fx, camera.fy]), (camera.cx, camera.cy)
    return camera.lens.undistort((points - center) / focal * camera.lens.zoom) * focal + center


def _places(camera: Camera, height: int, width: int) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the first row of strips of a photo, and where its pixels lie in the small picture, (n, W, 2) float32.

    x and y as OpenCV counts them: of the centres of pixels, the first one's being 0.
    """

    def in_pinhole(points: np.ndarray) -> np.ndarray:
        found = _pinhole_points(points, camera)
        return (
            np.where(np.isfinite(found), found, points) - 0.5
        )  # beyond the lens' reach the reader shows nothing

    found = knots(camera.width, camera.height, in_pinhole)
    columns, step = (np.arange(width) + 0.5) / width, max(1, STRIP // width)
    for top in range(0, height, step):
        rows = (np.arange(top, min(top + step, height)) + 0.5) / height
        yield top, between_knots(found, rows, columns)
