"""How much memory a process has used, and how much of it what is kept there takes."""

import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

# Of Linux, in kB: VmHWM is the most that was in memory since the program started, VmRSS what is in memory
_STATUS = "/proc/{}/status"
_MEMORY = "/proc/meminfo"  # MemAvailable is what can be taken without swapping
_NO_PARTS = (types.ModuleType, types.FunctionType, types.BuiltinFunctionType, types.MethodType)


def peak_memory() -> float | None:
    """Return the largest resident size of this process so far in GiB, or None on systems that do not count it."""
    if (held := _counted(_STATUS.format("self"), "VmHWM")) is not None:
        return held / 2**30
    try:  # Linux' count of resources would hold the peak of whoever started the process, too
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30


def resident_bytes(pid: int) -> int | None:
    """Return the resident size of a process in bytes, None where it has ended or the system does not tell."""
    return _counted(_STATUS.format(pid), "VmRSS")


def available_bytes() -> int | None:
    """Return how much more memory programs can take on this machine, None where it does not tell (not Linux)."""
    return _counted(_MEMORY, "MemAvailable")


def _counted(file: str, name: str) -> int | None:
    """Return the bytes of a line `name: 123 kB` in a file of the system, None without it."""
    try:
        return 1024 * int(Path(file).read_text().partition(f"{name}:")[2].split(maxsplit=1)[0])
    except (OSError, ValueError, IndexError):
        return None


def held_bytes(value: object) -> int:
    """Return the bytes of all tensors and arrays that can be reached from `value`, each counted once.

    Followed are containers, modules of PyTorch and objects with attributes, caches included.
    """
    storages: dict[int, int] = {}
    seen: set[int] = set()
    waiting = [value]
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, str | bytes | int | float | type(None) | type):
            continue
        seen.add(id(one))
        if isinstance(one, torch.Tensor):
            storage = one.untyped_storage()
            storages[storage.data_ptr()] = max(storages.get(storage.data_ptr(), 0), storage.nbytes())
        elif isinstance(one, np.ndarray):
            while isinstance(one.base, np.ndarray):
                one = one.base
            storages[one.__array_interface__["data"][0]] = one.nbytes
        else:
            waiting.extend(_parts(one))
    return sum(storages.values())


def _parts(value: Any) -> Iterator[object]:
    """Yield what an object consists of; nothing of what belongs to Python, such as functions and open files."""
    if isinstance(value, dict):
        yield from value.values()
    elif isinstance(value, list | tuple | set | frozenset):
        yield from value
    elif hasattr(value, "__dict__") and not isinstance(value, _NO_PARTS):
        yield from vars(value).values()
