"""Tensors on disk without pickle, and checkpoints that are either whole or absent.

A checkpoint is a folder `step-000001500/` with `tensors.safetensors` and `state.json`. It is filled under a
temporary name, flushed to the disk and renamed, so a process killed at any moment leaves the previous
checkpoint untouched. Equal tensors, metadata and state give equal bytes.
"""

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load, save

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import atomic_folder, disk_errors, write_bytes
from lightprobe.core.stored import check_tensors, checked_object, read_object, rules_like

_METADATA_KEY = "lightprobe"  # one key, because the format does not keep the order of several
_PASS_OVER = "remove this checkpoint"
STATE = "state.json"  # of a checkpoint, which cannot be read without it
_STEP_FOLDER = re.compile(r"step-(\d{9,})")


def save_tensors(
    path: Path, tensors: dict[str, torch.Tensor], metadata: dict[str, Any] | None = None
) -> None:
    """Write named tensors (any device, any shape) and a small JSON object to a safetensors file, atomically.

    Raises `ResourceError` when the disk refuses.
    """
    write_bytes(path, _encode(tensors, metadata))


def load_tensors(path: Path) -> dict[str, torch.Tensor]:
    """Return the tensors of a safetensors file, on the CPU; raise `InputError` when it is missing or damaged."""
    try:
        return load(Path(path).read_bytes())
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist.") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    except (SafetensorError, ValueError, KeyError) as error:
        raise InputError(f"{path} is damaged or not a safetensors file.") from error


def load_metadata(path: Path) -> dict[str, Any]:
    """Return the `metadata` given to `save_tensors`; raise `InputError` when the file is missing or damaged."""
    if not Path(path).is_file():
        raise InputError(f"{path} does not exist.")
    try:
        with safe_open(path, framework="pt") as file:
            return json.loads((file.metadata() or {}).get(_METADATA_KEY, "{}"))
    except (SafetensorError, OSError, json.JSONDecodeError) as error:
        raise InputError(f"{path} is damaged or not a safetensors file; make it again.") from error


class Checkpoints:
    """The checkpoints of one training phase, in one folder, of which the last `keep` are kept."""

    def __init__(self, folder: Path, keep: int = 2):
        self.folder = Path(folder)
        self.keep = keep

    def save(self, step: int, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Write the checkpoint of `step` whole, then remove the ones before the last `keep`.

        `state` is a JSON object: whatever the training loop needs beside its tensors.
        """
        with atomic_folder(self.folder / _name(step)) as temporary:
            _write_synced(temporary / "tensors.safetensors", _encode(tensors, None))
            text = json.dumps({"step": step, "state": state}, indent=2, sort_keys=True, allow_nan=False)
            _write_synced(temporary / STATE, (text + "\n").encode())
            _sync_folder(temporary)
        _sync_folder(self.folder)
        self.prune()

    def prune(self) -> None:
        """Remove all but the last `keep`, for a training that goes on after a cut last save."""
        for _, old in list(self._newest_first())[self.keep :]:
            self._remove(old)

    def latest(self) -> tuple[int, dict[str, torch.Tensor], dict[str, Any]] | None:
        """Return (step, tensors, state) of the newest readable checkpoint, or None when there is none.

        A damaged checkpoint, also one with NaN in it, is passed over for the one before it.
        """
        for step, folder in self._newest_first():
            try:
                return step, *_read(folder)
            except InputError:
                continue
        return None

    def newest_step(self) -> int | None:
        """Return the step of the newest checkpoint, readable or not, or None when there is none."""
        return next((step for step, _ in self._newest_first()), None)

    @contextlib.contextmanager
    def restoring(self, step: int) -> Iterator[None]:
        """Turn what goes wrong while the checkpoint of `step` is used into an `InputError` with the remedy."""
        try:
            yield
        except (InputError, ConfigError, KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
            detail = f"there is no {error}" if isinstance(error, KeyError) else str(error).split("\n")[0]
            raise InputError(
                f"The checkpoint {self.folder / _name(step)} does not fit this training ({detail.rstrip('.')}); remove it "
                "to go on from the one before it, or start over with --restart."
            ) from error

    def _newest_first(self) -> Iterator[tuple[int, Path]]:
        names = os.listdir(self.folder) if self.folder.is_dir() else []
        steps = (int(match[1]) for name in names if (match := _STEP_FOLDER.fullmatch(name)))
        return ((step, self.folder / _name(step)) for step in sorted(steps, reverse=True))

    def _remove(self, folder: Path) -> None:
        """Delete under another name first: a half-deleted folder must not look like a checkpoint."""
        with disk_errors(folder):
            doomed = folder.with_name(f".partial-{folder.name}")
            shutil.rmtree(doomed, ignore_errors=True)
            folder.rename(doomed)
            shutil.rmtree(doomed, ignore_errors=True)


def stored_like(tensors: Mapping[str, torch.Tensor], name: str, like: torch.Tensor) -> torch.Tensor:
    """Return a checkpoint's tensor (any shape) on the device of `like`; `ValueError` for another shape or type.

    A tensor of another shape would be spread over the parameter that it is copied to.
    """
    found = tensors[name]
    if found.shape != like.shape or found.dtype != like.dtype:
        given, wanted = (f"{list(t.shape)} of {t.dtype}" for t in (found, like))
        raise ValueError(f"'{name}' is {given}, not {wanted}")
    return found.to(like.device)


@torch.no_grad()
def copy_stored(tensors: Mapping[str, torch.Tensor], into: Mapping[str, torch.Tensor]) -> None:
    """Copy a checkpoint's tensors into those of the same names; raise `KeyError` or `ValueError` else."""
    for name, tensor in into.items():
        tensor.copy_(stored_like(tensors, name, tensor))


def _name(step: int) -> str:
    return f"step-{step:09d}"


def _read(folder: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Return (tensors, state); raise `InputError` when a file is missing, damaged or holds NaN."""
    tensors, path = load_tensors(folder / "tensors.safetensors"), folder / STATE
    check_tensors(tensors, rules_like(tensors), folder, _PASS_OVER)
    return tensors, checked_object(read_object(path, _PASS_OVER).get("state"), path, _PASS_OVER, "state")


def _encode(tensors: dict[str, torch.Tensor], metadata: dict[str, Any] | None) -> bytes:
    plain = {name: tensor.detach().to("cpu", copy=True).contiguous() for name, tensor in tensors.items()}
    text = json.dumps(metadata or {}, sort_keys=True, allow_nan=False)
    return save(plain, {_METADATA_KEY: text})


def _write_synced(path: Path, data: bytes) -> None:
    with open(path, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Make the renames in `folder` survive a power cut; Windows cannot open folders and needs no such step."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
