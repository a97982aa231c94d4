"""Choice of the body that serves an op, by device and dtype: Numba, Triton, or the plain reference.

A body is a module with the op's forward and backward functions, `kernels/<body>/<op>.py`, loaded when first
needed: so Triton is missed only where it would be used, and there the reference takes its place, as it does
for an op that has no body for the device.
"""

import functools
import importlib
import importlib.util
import warnings
from enum import StrEnum
from types import ModuleType

import torch
from torch import Tensor

from lightprobe.core.errors import LightprobeWarning


class Body(StrEnum):
    """The packages of bodies."""

    NUMBA = "numba"
    TRITON = "triton"
    REFERENCE = "reference"


def choose(op: str, *tensors: Tensor) -> ModuleType:
    """Return the module that serves `op` (a module name under each body's package) for these tensors of any
    shape.

    An op of NumPy arrays, which live on the CPU, gives none. Raises ValueError when devices or floating
    dtypes are mixed, because the op would then mean two things.
    """
    devices = {tensor.device for tensor in tensors}
    dtypes = {tensor.dtype for tensor in tensors if tensor.is_floating_point()}
    if len(devices) > 1 or len(dtypes) > 1:
        raise ValueError(
            f"All tensors of one op must share a device and a floating dtype, not {devices} and {dtypes}."
        )
    device = devices.pop().type if devices else "cpu"
    return _module(body_for(device) if dtypes <= {torch.float32} else Body.REFERENCE, op)


@functools.cache
def _module(body: Body, op: str) -> ModuleType:
    name = f"{__package__}.{body}.{op}"
    if importlib.util.find_spec(name) is None:
        name = f"{__package__}.{Body.REFERENCE}.{op}"
    return importlib.import_module(name)


def body_for(device: str) -> Body:
    """Return the fastest body for float32 tensors on a type of device."""
    if device == "cpu":
        return Body.NUMBA
    return Body.TRITON if device == "cuda" and _has_triton() else Body.REFERENCE


@functools.cache
def _has_triton() -> bool:
    """Return whether Triton runs here: it builds a small helper, with a C compiler and Python's headers."""
    try:
        importlib.import_module("triton").runtime.driver.active.get_current_target()
    except Exception as error:  # what is missing shows as anything from ImportError to a failed subprocess
        sentence = f"Triton cannot be used, so the GPU runs the slow reference kernels: {error}"
        warnings.warn(sentence, LightprobeWarning, stacklevel=2)
        return False
    return True


def require_shape(name: str, tensor: Tensor, *shape: int | None) -> None:
    """Raise ValueError unless `tensor`, which may come in any shape, has this one; None stands for any size."""
    matches = tensor.ndim == len(shape) and all(
        want in (None, size) for want, size in zip(shape, tensor.shape, strict=True)
    )
    if not matches:
        wanted = tuple("any" if size is None else size for size in shape)
        raise ValueError(f"{name} must have shape {wanted}, not {tuple(tensor.shape)}.")


def require_index(name: str, index: Tensor, size: int) -> None:
    """Raise ValueError unless `index` is integer; raise IndexError unless its values lie in [0, size).

    Values are looked at on the CPU only: compiled loops do not check them, and elsewhere a look would stall
    the device.
    """
    if index.dtype not in (torch.int32, torch.int64):
        raise ValueError(f"{name} must be int32 or int64, not {index.dtype}.")
    if index.device.type != "cpu" or index.numel() == 0:
        return
    low, high = (int(value) for value in torch.aminmax(index))
    if low < 0 or high >= size:
        raise IndexError(f"{name} holds values from {low} to {high}; they must lie in [0, {size}).")
