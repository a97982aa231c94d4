"""The object of a run in training for the page: the surface of its newest checkpoint, and its base colours.

preview.bin, little endian: vertex count V and face count F as uint32, then, in glTF's y-up frame and the user's
units, the object's middle (3,) float64 and (V, 3) float32 positions from there; (V, 3) float32 linear base colours,
(F, 3) uint32 corners.
"""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes
from lightprobe.core.run import RunFolder
from lightprobe.export.gltf_mesh import to_y_up
from lightprobe.reconstruction.checkpoint_preview import CheckpointPreview
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Similarity
from lightprobe.scene.record import read_record
from lightprobe.view.sources import RunSource

FILE = "preview.bin"


class CheckpointPreviews:
    """Reads the object out of the newest checkpoint of a run; keeps what it needs of the run asked for last."""

    def __init__(self, device: torch.device):
        """Compute on `device`."""
        self._device = device
        self._known: tuple[tuple[Path, str], CheckpointPreview] | None = None  # by run and training

    def write(self, path: Path, folder: Path, tell: Callable[[str], None]) -> dict[str, Any]:
        """Write preview.bin into `folder`, return its step and sizes; raise `InputError` without a checkpoint."""
        run = RunFolder.open(path)
        latest = run.checkpoints.latest()
        if latest is None:
            raise InputError("There is no checkpoint yet; the object appears with the first one.")
        step, tensors, state = latest
        record, training = read_record(run), (path, RunSource(run).begun)
        if self._known is None or self._known[0] != training:
            tell("reading the photos")
            self._known = training, CheckpointPreview(load_scene(record.root), self._device)
        tell("reading the surface")
        surface = self._known[1].surface(tensors, state)
        data = encoded(surface.vertices, surface.faces, surface.color, record.similarity)
        write_bytes(folder / FILE, data)
        files = [{"name": FILE, "title": "surface"}]
        return {"files": files, "step": step, "stage": surface.stage, "faces": len(surface.faces)}


def encoded(
    vertices: torch.Tensor, faces: torch.Tensor, color: torch.Tensor, similarity: Similarity
) -> bytes:
    """Return vertices (V, 3) of the normalised frame, faces (F, 3) and linear colours (V, 3) as preview.bin."""
    positions = to_y_up(similarity.scale * vertices.double().cpu().numpy()).astype("<f4")
    colors, corners = color.clamp(0, 1).cpu().numpy().astype("<f4"), faces.cpu().numpy().astype("<u4")
    head = struct.pack("<II3d", len(positions), len(corners), *to_y_up(similarity.center))
    return head + b"".join(np.ascontiguousarray(part).tobytes() for part in (positions, colors, corners))
