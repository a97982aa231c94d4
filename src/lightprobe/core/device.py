"""Choice of the torch device and the stateless random streams that make a run reproducible."""

import hashlib

import torch

from lightprobe.core.errors import ConfigError


def resolve_device(name: str | torch.device) -> torch.device:
    """Return the torch device of a name: `cpu`, `cuda`, `cuda:N`, or `auto`, which takes a GPU when there is one.

    A device stands for its own name. A GPU is made to compute in `full_precision`.
    """
    name = str(name)
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f"Unknown device '{name}': use auto, cpu or cuda.") from error
    if device.type not in ("cpu", "cuda"):
        raise ConfigError(f"Device '{name}' is not supported: use auto, cpu or cuda.")
    if device.type == "cpu":
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise ConfigError(
            f"Device '{name}' was asked for, but PyTorch sees no CUDA device: use --device cpu or auto."
        )
    # With its number, as tensors have it: `cuda` and `cuda:0` would each get tables of their own.
    number = torch.cuda.current_device() if device.index is None else device.index
    if number >= torch.cuda.device_count():
        raise ConfigError(
            f"There is no device '{name}': this machine has {torch.cuda.device_count()} CUDA device(s)."
        )
    return full_precision(torch.device("cuda", number))


def full_precision(device: torch.device) -> torch.device:
    """Let a GPU's products of matrices and convolutions keep the 24 bits of float32, and return the device.

    cuDNN rounds the factors of its convolutions to TF32's 11 bits unless told otherwise: that alone moves a
    predicted map by 1.4e-3, more than the CPU and a GPU may differ by. The setting is PyTorch's, for the
    whole process.
    """
    if device.type == "cuda":
        torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = False
        torch.backends.cudnn.fp32_precision = "ieee"  # the newer name, which may have been set before
    return device


def generator(seed: int, stream: str, step: int = 0) -> torch.Generator:
    """Return a CPU generator that depends only on (seed, stream, step).

    Stateless streams need no place in a checkpoint: a resumed run draws the numbers an uninterrupted one
    would.
    """
    digest = hashlib.blake2b(f"{seed}/{stream}/{step}".encode(), digest_size=8).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest, "little") >> 1)


def to_device(tensor: torch.Tensor, device: torch.device) -> torch.Tensor:
    """Return a CPU tensor of any shape on `device`, without waiting for what a GPU is still doing."""
    return tensor.pin_memory().to(device, non_blocking=True) if device.type == "cuda" else tensor.to(device)


def draw_rows(rows: torch.Tensor, count: int, random: torch.Generator) -> torch.Tensor:
    """Return at most `count` of the row numbers (N,), drawn without replacement, in their order."""
    if len(rows) <= count:
        return rows
    return rows[to_device(torch.randperm(len(rows), generator=random)[:count].sort().values, rows.device)]
