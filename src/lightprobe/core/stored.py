"""What a run's files must hold, checked where they are read, so that nothing later guards against it.

A run may come from elsewhere, or from a disk that failed. Every error names the file, what is wrong, and the
remedy.
"""

import contextlib
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json


@dataclass(frozen=True)
class TensorRule:
    """What a tensor must be; a letter in `shape` is any size above zero, the same for all rules of a file."""

    shape: tuple[int | str, ...]
    dtype: torch.dtype = torch.float32
    low: float = -math.inf
    high: float = math.inf
    below: str | None = None  # of an index: the letter of the size that it stays under, of an earlier rule


def read_object(path: Path, remedy: str) -> dict[str, Any]:
    """Return the JSON object in a file; raise `InputError` with the `remedy` when there is none."""
    with remedied(remedy):
        return checked_object(read_json(path), path, remedy)


@contextlib.contextmanager
def remedied(remedy: str) -> Iterator[None]:
    """Add the remedy to an `InputError` that does not name it yet."""
    try:
        yield
    except InputError as error:
        if remedy in str(error):
            raise
        raise InputError(f"{str(error).rstrip('.')}; {remedy}.") from error


def checked_object(value: Any, path: Path, remedy: str, key: str = "") -> dict[str, Any]:
    """Return `value`, which `key` of a file holds, or raise `InputError` when it is no JSON object."""
    if not isinstance(value, dict):
        raise damaged(path, f"{f'{key!r} is' if key else 'it holds'} no JSON object", remedy)
    return value


def check_tensors(
    tensors: Mapping[str, Tensor], rules: Mapping[str, TensorRule], path: Path, remedy: str
) -> None:
    """Raise `InputError` unless every tensor of `rules` is there, of its type and shape and in range."""
    sizes: dict[str, int] = {}
    for name, rule in rules.items():
        if name not in tensors:
            raise damaged(path, f"it has no '{name}'", remedy)
        fault = _fault(tensors[name], rule, sizes)
        if fault:
            raise damaged(path, f"'{name}' {fault}", remedy)


def rules_like(tensors: Mapping[str, Tensor]) -> dict[str, TensorRule]:
    """Return the rules that tensors are to be as the given ones, but for their values."""
    return {name: TensorRule(tuple(tensor.shape), tensor.dtype) for name, tensor in tensors.items()}


def is_finite_number(value: Any) -> bool:
    """Return whether a JSON value is a number that a float can hold; JSON's integers have no end."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def damaged(path: Path, why: str, remedy: str) -> InputError:
    """Return the error for a file of a run that cannot be used."""
    return InputError(f"{path} is damaged or does not fit this run: {why.rstrip('.')}; {remedy}.")


def _fault(tensor: Tensor, rule: TensorRule, sizes: dict[str, int]) -> str | None:
    """Return what is wrong with a tensor, or None; letters met for the first time go to `sizes`."""
    shape = tuple(tensor.shape)
    fits = len(shape) == len(rule.shape)
    for size, wanted in zip((*shape, *(0 for _ in rule.shape)), rule.shape, strict=False):
        known = sizes.setdefault(wanted, size) if isinstance(wanted, str) else wanted
        fits = fits and size == known and (size > 0 or not isinstance(wanted, str))
    if not fits or tensor.dtype != rule.dtype:
        wanted_shape = (str((sizes[w] or w) if isinstance(w, str) else w) for w in rule.shape)
        words, given = (" x ".join(each) or "one number" for each in (wanted_shape, map(str, shape)))
        return f"is {given} of {_short(tensor.dtype)}, not {words} of {_short(rule.dtype)}"
    if not tensor.numel():
        return None
    low, high = (float(value) for value in tensor.aminmax())
    if not math.isfinite(low) or not math.isfinite(high):
        return "holds NaN or infinity"
    last = rule.high if rule.below is None else sizes[rule.below] - 1
    first = rule.low if rule.below is None else 0
    return (
        None if first <= low and high <= last else f"holds {low:g} to {high:g}, beyond {first:g} to {last:g}"
    )


def _short(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")
