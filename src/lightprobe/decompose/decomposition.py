"""What Phase I leaves behind, and its files in the run folder."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json
from lightprobe.core.run import RunFolder
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Similarity

LIGHTS_FILE = "lights.safetensors"


@dataclass(frozen=True)
class Decomposition:
    """A textured mesh, the light of every training photo, and the way back to the user's frame."""

    asset: Asset
    lights: dict[str, Tensor]  # photo name -> (6, R, R, 3) linear radiance
    similarity: Similarity

    def save(self, run: RunFolder) -> None:
        """Write the asset and the lights; the asset comes last and marks Phase I as finished."""
        names = sorted(self.lights)
        save_tensors(_lights_file(run), {name: self.lights[name] for name in names})
        self.asset.save(run.asset_file)

    @staticmethod
    def load(run: RunFolder, device: torch.device) -> "Decomposition":
        """Read what `save` wrote; raise `InputError` when Phase I has not finished in this run."""
        if not run.asset_file.is_file():
            root = read_json(run.scene_file)["root"] if run.scene_file.is_file() else "SCENE"
            raise InputError(
                f"{run.path} has no reconstructed object yet, Phase I has not finished in it; "
                f"go on with: lightprobe train {root} -o {run.path}"
            )
        asset = Asset.load(run.asset_file).to(device)
        lights = {name: light.to(device) for name, light in load_tensors(_lights_file(run)).items()}
        similarity = Similarity.from_json(read_json(run.scene_file)["similarity"])
        return Decomposition(asset, lights, similarity)


def _lights_file(run: RunFolder) -> Path:
    return run.mesh_folder / LIGHTS_FILE
