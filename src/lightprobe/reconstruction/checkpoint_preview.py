"""A preview of an unfinished Phase I: the surface and base colours that a checkpoint holds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from lightprobe.core.checkpoint import copy_stored, stored_like
from lightprobe.core.config import DecomposeConfig
from lightprobe.core.errors import InputError
from lightprobe.geometry.textures import sample
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.phase1 import AssetAndLights, split_validation
from lightprobe.reconstruction.photos import load_targets
from lightprobe.reconstruction.start import start_shape
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.scene.photo import Scene
from lightprobe.training.loop import without_prefix

_FIRST, _THIRD = "pass1", "pass3"


@dataclass(frozen=True)
class PreviewSurface:
    """A surface with a colour at each vertex, in the normalised frame."""

    stage: str
    vertices: Tensor  # (V, 3)
    faces: Tensor  # (F, 3) int32
    color: Tensor  # (V, 3) linear base colour


class CheckpointPreview:
    """Reads surfaces out of the checkpoints of one training; the lattice of its first pass is made once."""

    def __init__(self, scene: Scene, device: torch.device):
        """Take the scene that the training learns from."""
        self._scene, self._device = scene, device
        self._made: tuple[dict[str, Any], LatticeModel] | None = None

    @torch.no_grad()
    def surface(self, tensors: Mapping[str, Tensor], state: Mapping[str, Any]) -> PreviewSurface:
        """Return the surface of a checkpoint of Phase I; raise `InputError` for another checkpoint."""
        try:
            config = DecomposeConfig.from_json(state["config"])
            made = self._lattice_surface if state["stage"] == _FIRST else self._textured_surface
            return PreviewSurface(state["stage"], *made(tensors, config, state))
        except (KeyError, ValueError, RuntimeError) as error:
            raise InputError(
                f"The newest checkpoint does not fit this run's scene and settings ({error})."
            ) from error

    def _lattice_surface(
        self, tensors: Mapping[str, Tensor], config: DecomposeConfig, state: Mapping[str, Any]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the fields of the surface from the first pass, whose model is made once: this takes long."""
        if self._made is None or self._made[0] != state["config"]:
            photos = split_validation(self._scene.train, config.validation_photos)[0]
            targets = load_targets(self._scene, photos, config.pass1_side, self._device)
            start = start_shape(self._scene, config, state["seed"], photos, targets)
            self._made = dict(state["config"]), LatticeModel(start, config, self._device, state["seed"])
        model = self._made[1]
        _load(tensors, model)
        vertices, faces = (torch.from_numpy(array).to(self._device) for array in model.extract())
        return vertices, faces, model.material(vertices)[:, :3]

    def _textured_surface(
        self, tensors: Mapping[str, Tensor], config: DecomposeConfig, state: Mapping[str, Any]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the fields of the surface from a later pass; a vertex on a seam has any of its colours."""
        asset = AssetAndLights.of(without_prefix("start.", tensors), self._device).asset
        if state["iteration"] > 0:
            if state["stage"] == _THIRD:
                size = max(config.pass3_texture_size, asset.textures.size)
                asset = replace(asset, textures=asset.textures.resized(size))
            model = SurfaceModel(asset, replace(config, shadows=False), state["seed"])
            _load(tensors, model)
            asset = model.asset()
        mesh = asset.mesh
        at_uv = sample(asset.textures.flat(), mesh.uvs)[:, :3]
        color = torch.zeros_like(mesh.vertices)
        color[mesh.faces.long().reshape(-1)] = at_uv[mesh.uv_faces.long().reshape(-1)]
        return mesh.vertices, mesh.faces, color


def _load(tensors: Mapping[str, Tensor], model: LatticeModel | SurfaceModel) -> None:
    """Put a checkpoint's parameters, and what its model has chosen, in place."""
    for group in model.groups():
        for name, parameter in group.parameters.items():
            parameter.copy_(stored_like(tensors, f"parameter.{name}", parameter))
    copy_stored(without_prefix("buffer.", tensors), model.chosen())
