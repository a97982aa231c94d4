"""What stands in front of the object: where its silhouette is, but the photo does not look like it in any
light.

Each of the object's pixels is either the object's or something else's. The labels minimise

    sum_object cost(p) + sum_other _OTHER + _SMOOTH |boundary between labels|

cost(p): squared differences of appearance between the photo and the object under the light found with the
labels so far, in usual errors of a right pose. A photo brighter than the object costs less than a darker one:
highlights that a coarse light cannot draw are the object's. The minimum is a minimum cut (Greig, Porteous &
Seheult 1989).
"""

import numpy as np
import scipy
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from lightprobe.imaging.resize import STRIP
from lightprobe.localization.appearance import PhotoPyramid
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.refinement import fitted_light
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene.camera import Camera

_DIAMETER = 90  # pixels of the object's sphere that labels are found at
_DARKER, _BRIGHTER, _TINT = 0.7, 2.0, 0.1  # usual errors of the appearance
_OTHER, _SMOOTH = 3.0, 2.5  # costs
_LUMA = np.full(3, 1 / 3)  # of red, green and blue
_FLOOR = 0.02  # added to linear values: what is darker has no colour
_MOST = 8.0  # cost of a pixel
_ROUNDS = 3  # of light and labels
_LEAST = 0.02  # of the object's pixels: smaller regions are errors of the asset
_UNITS = 1000  # capacities are integers


def hidden_share(known: KnownObject, pyramid: PhotoPyramid, camera: Camera) -> np.ndarray:
    """Return the share of each pixel that something in front of the object covers, (H, W) float32.

    camera: normalised frame, in the photo's pixels. The share is 0 outside of the object.
    """
    far = float(np.linalg.norm(camera.position))
    photo = pyramid.near(_DIAMETER / (2 * camera.fx / far))
    view = View.of(camera.resized(*photo.size), known.mesh.vertices.device)
    surface = visible_surface(known.mesh.vertices, known.mesh.faces, view)
    pixel = surface.pixel.cpu().numpy()
    width, height = photo.size
    whole = np.zeros((pyramid.size[1], pyramid.size[0]), np.float32)
    if len(pixel) < 2:
        return whole
    row, column = np.divmod(pixel, width)
    matrix = known.transport(surface, view).double().cpu().numpy()
    color, clipped = photo.color[row, column].T, photo.clipped[row, column].T
    other = np.zeros(len(pixel), bool)
    for _ in range(_ROUNDS):
        light = fitted_light(matrix[:, ~other], color[:, ~other], clipped[:, ~other])[2]
        cost = _cost(np.einsum("cnt,ct->nc", matrix, light), color.T)
        other = _large(_labels(cost, pixel, width), row, column, (height, width))
        if other.mean() > 0.5 or not other.any():  # more is a wrong pose, which the verdict tells
            break
    if not 0 < other.mean() <= 0.5:
        return whole
    small = np.zeros((height, width), np.float32)
    small[row, column] = other
    return magnified(small, whole.shape)


def _cost(render: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the cost (N,) of being the object's for linear colours (N, 3) of the render and of the photo."""
    logs = (np.log(np.maximum(color, 0) @ _LUMA + _FLOOR) for color in (seen, render))
    brighter = next(logs) - next(logs)
    tints = [color / (color.sum(1, keepdims=True) + 3 * _FLOOR) for color in (seen, np.maximum(render, 0))]
    luma = np.where(brighter > 0, brighter / _BRIGHTER, brighter / _DARKER)
    return np.minimum(luma**2 + ((tints[0] - tints[1]) ** 2).sum(1) / _TINT**2, _MOST)


def _labels(cost: np.ndarray, pixel: np.ndarray, width: int) -> np.ndarray:
    """Return which of the row-major pixels (N,), ascending, are something else's, (N,) bool."""
    count = len(pixel)
    pairs = []
    for step in (1, width):
        at = np.searchsorted(pixel, pixel + step).clip(max=count - 1)
        beside = (pixel[at] == pixel + step) & ((step > 1) | (pixel % width < width - 1))
        pairs.append(np.stack([np.flatnonzero(beside), at[beside]]))
    one, two = np.concatenate(pairs, 1)
    source, sink, every = count, count + 1, np.arange(count)
    # an object's pixel stays with the sink: cutting source -> pixel costs what being the object's costs
    start = np.concatenate([np.full(count, source), every, one, two])
    end = np.concatenate([every, np.full(count, sink), two, one])
    weight = np.concatenate([cost, np.full(count, _OTHER), np.full(2 * len(one), _SMOOTH)])
    capacity = np.rint(_UNITS * weight).astype(np.int32)
    graph = coo_matrix((capacity, (start, end)), shape=(count + 2, count + 2)).tocsr()
    left = graph - maximum_flow(graph, source, sink).flow
    left.eliminate_zeros()
    reached = breadth_first_order(left, source, return_predecessors=False)
    other = np.zeros(count + 2, bool)
    other[reached] = True
    return other[:count]


def _large(other: np.ndarray, row: np.ndarray, column: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the labels (N,) without regions that are too small to be anything."""
    picture = np.zeros(size, bool)
    picture[row, column] = other
    region, count = scipy.ndimage.label(picture)
    sizes = np.bincount(region.ravel(), minlength=count + 1)
    return other & (sizes[region[row, column]] >= _LEAST * len(other))


def magnified(small: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a picture (h, w) bilinearly enlarged to `size` (H, W), float32."""
    rows, columns = ((np.arange(n) + 0.5) * s / n - 0.5 for n, s in zip(size, small.shape, strict=True))
    large, step = np.empty(size, np.float32), max(1, STRIP // size[1])
    for top in range(0, size[0], step):
        grid = np.meshgrid(rows[top : top + step], columns, indexing="ij")
        large[top : top + step] = scipy.ndimage.map_coordinates(small, grid, order=1, mode="nearest")
    return large
