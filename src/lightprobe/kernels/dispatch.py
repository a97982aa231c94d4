"""Choice of the backend that serves an op, by device and dtype: Numba, Triton, or the plain PyTorch reference.

A backend is a package of modules, `kernels/<backend>/<op>.py`, with each op's forward and backward functions. A
module is imported when it is first needed, so Triton is missed only where it would be used; there the reference
takes its place, as it does for an op that the device's backend lacks.
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


class Backend(StrEnum):
    """The implementations of the kernels, named as their packages."""

    NUMBA = "numba"
    TRITON = "triton"
    REFERENCE = "reference"


def choose(op: str, *tensors: Tensor) -> ModuleType:
    """Return the module that serves `op` (a module name within each backend) for tensors of any shape.

    Raises ValueError when devices or floating dtypes are mixed: the op would then be ambiguous.
    """
    devices = {tensor.device for tensor in tensors}
    dtypes = {tensor.dtype for tensor in tensors if tensor.is_floating_point()}
    if len(devices) > 1 or len(dtypes) > 1:
        raise ValueError(
            f"Tensors of one op must share a device and a floating dtype, not {devices}, {dtypes}."
        )
    return _module(backend_for(devices.pop().type) if dtypes <= {torch.float32} else Backend.REFERENCE, op)


def compiled_loops(op: str, work: int) -> ModuleType:
    """Return Numba's loops of an op of NumPy arrays, with threads for `work` steps of about a nanosecond."""
    importlib.import_module("lightprobe.core.jit").threads(work)  # imported late: Numba takes a while
    return _module(Backend.NUMBA, op)


@functools.cache
def _module(backend: Backend, op: str) -> ModuleType:
    name = f"{__package__}.{backend}.{op}"
    if importlib.util.find_spec(name) is None:
        name = f"{__package__}.{Backend.REFERENCE}.{op}"
    return importlib.import_module(name)


def backend_for(device: str) -> Backend:
    """Return the fastest backend for float32 tensors on a type of device."""
    if device == "cpu":
        return Backend.NUMBA
    return Backend.TRITON if device == "cuda" and _has_triton() else Backend.REFERENCE


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
    """Raise ValueError unless `tensor`, of any shape, has this one; None stands for any size."""
    sizes = zip(shape, tensor.shape, strict=False)
    matches = tensor.ndim == len(shape) and all(want in (None, size) for want, size in sizes)
    if not matches:
        wanted = tuple("any" if size is None else size for size in shape)
        raise ValueError(f"{name} must have shape {wanted}, not {tuple(tensor.shape)}.")


def require_index(name: str, index: Tensor, size: int) -> None:
    """Raise ValueError unless `index` is integer; raise IndexError unless its values lie in [0, size).

    Values are checked on the CPU only, where compiled loops would read beyond the array; a GPU would stall.
    """
    if index.dtype not in (torch.int32, torch.int64):
        raise ValueError(f"{name} must be int32 or int64, not {index.dtype}.")
    if index.device.type != "cpu" or index.numel() == 0:
        return
    low, high = (int(value) for value in torch.aminmax(index))
    if low < 0 or high >= size:
        raise IndexError(f"{name} holds values from {low} to {high}; they must lie in [0, {size}).")
