"""How much memory a process has used, and how much of it what is kept there takes."""

import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

_PAGE_TABLE = "/proc/{}/statm"  # Linux: sizes in pages, the second is what is in memory
_STATUS = Path(
    "/proc/self/status"
)  # Linux: VmHWM is the most that was in memory since the program started, in kB
_MEMORY = Path("/proc/meminfo")  # Linux: MemAvailable is what can be taken without swapping, in kB
_PAGE = 4096  # bytes, on all systems that Linux' wheels of PyTorch are built for, unless the system says otherwise
_NO_PARTS = (types.ModuleType, types.FunctionType, types.BuiltinFunctionType, types.MethodType)


def peak_memory() -> float | None:
    """Return the largest resident size of this process so far in GiB, or None on systems that do not count
    it.
    """
    held = _high_water_mark()
    return None if held is None else held / 2**30


def _high_water_mark() -> int | None:
    """Return it in bytes. Linux' count of resources holds the peak of whoever started the process, too."""
    try:
        status = _STATUS.read_text()
        return 1024 * int(status.partition("VmHWM:")[2].split(maxsplit=1)[0])
    except (OSError, ValueError, IndexError):
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def resident_bytes(pid: int) -> int | None:
    """Return the resident size of a process in bytes, None where it has ended or the system does not tell."""
    try:
        pages = int(Path(_PAGE_TABLE.format(pid)).read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return None
    return pages * _page_size()


def _page_size() -> int:
    try:
        import resource
    except ImportError:
        return _PAGE
    return resource.getpagesize()


def available_bytes() -> int | None:
    """Return how much more memory programs can take on this machine, None where it does not tell (not Linux)."""
    try:
        return 1024 * int(_MEMORY.read_text().partition("MemAvailable:")[2].split(maxsplit=1)[0])
    except (OSError, ValueError, IndexError):
        return None


def held_bytes(value: object) -> int:
    """Return the bytes of all tensors and arrays that can be reached from `value`, each counted once.

    Followed are containers, modules of PyTorch and objects with attributes; what is cached in these counts as
    well.
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
            base = _base(one)
            storages[base.__array_interface__["data"][0]] = base.nbytes
        else:
            waiting.extend(_parts(one))
    return sum(storages.values())


def _base(array: np.ndarray) -> np.ndarray:
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


def _parts(value: Any) -> Iterator[object]:
    """Yield what an object consists of; nothing of what belongs to Python, such as functions and open files."""
    if isinstance(value, dict):
        yield from value.values()
    elif isinstance(value, list | tuple | set | frozenset):
        yield from value
    elif hasattr(value, "__dict__") and not isinstance(value, _NO_PARTS):
        yield from vars(value).values()
