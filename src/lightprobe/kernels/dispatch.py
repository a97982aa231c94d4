"""Choice of the body that serves an op: Numba for float32 on the CPU, the plain reference for everything else.

A body is a module with the op's forward and backward functions. Another one (for a GPU, say) is added here, by device.
"""

from types import ModuleType

import torch
from torch import Tensor


def choose(fast: ModuleType, reference: ModuleType, *tensors: Tensor) -> ModuleType:
    """Return `fast` when every tensor is on the CPU and every floating tensor is float32, else `reference`.

    Raises ValueError when devices or floating dtypes are mixed, because the op would then mean two things.
    """
    devices = {tensor.device for tensor in tensors}
    dtypes = {tensor.dtype for tensor in tensors if tensor.is_floating_point()}
    if len(devices) > 1 or len(dtypes) > 1:
        raise ValueError(f"All tensors of one op must share a device and a floating dtype, not {devices} and {dtypes}.")
    on_cpu = all(device.type == "cpu" for device in devices)
    return fast if on_cpu and dtypes <= {torch.float32} else reference


def require_shape(name: str, tensor: Tensor, *shape: int | None) -> None:
    """Raise ValueError unless `tensor` has this shape; None stands for any size."""
    matches = tensor.ndim == len(shape) and all(
        want in (None, size) for want, size in zip(shape, tensor.shape, strict=True)
    )
    if not matches:
        wanted = tuple("any" if size is None else size for size in shape)
        raise ValueError(f"{name} must have shape {wanted}, not {tuple(tensor.shape)}.")


def require_index(name: str, index: Tensor, size: int) -> None:
    """Raise ValueError unless `index` is integer; raise IndexError unless its values lie in [0, size).

    Values are looked at on the CPU only: compiled loops do not check them, and elsewhere a look would stall the device.
    """
    if index.dtype not in (torch.int32, torch.int64):
        raise ValueError(f"{name} must be int32 or int64, not {index.dtype}.")
    if index.device.type != "cpu" or index.numel() == 0:
        return
    low, high = (int(value) for value in torch.aminmax(index))
    if low < 0 or high >= size:
        raise IndexError(f"{name} holds values from {low} to {high}; they must lie in [0, {size}).")
