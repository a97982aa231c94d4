"""What Phase I leaves behind, and its files in the run folder."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.config.stored import LIGHT_RESOLUTIONS
from lightprobe.core.errors import InputError
from lightprobe.core.files import shell_word
from lightprobe.core.run import REMAKE, RunFolder
from lightprobe.core.stored import TensorRule, check_tensors, damaged, remedied
from lightprobe.light.environment import Environment
from lightprobe.models.calibration import Calibration
from lightprobe.models.object_verdict import ObjectVerdict
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Similarity
from lightprobe.scene.record import read_record

LIGHTS_FILE = "lights.safetensors"


@dataclass(frozen=True)
class Decomposition:
    """A textured mesh, the light of every training photo, and the way back to the user's frame."""

    asset: Asset
    lights: dict[str, Environment]  # of every training photo, by name
    similarity: Similarity
    trained: Asset | None = None  # the asset in the run's own scale, where a calibration has changed it
    calibration: Calibration | None = None  # that `asset` and `lights` have been through
    verdict: ObjectVerdict | None = None  # where photos show enough of the object; older runs may lack it

    def save(self, run: RunFolder) -> None:
        """Write asset, lights and verdict; the asset comes last and marks Phase I as finished."""
        names = sorted(self.lights)
        save_tensors(_lights_file(run), {name: self.lights[name].texels for name in names})
        if self.verdict is not None:
            self.verdict.save(run.verdict_file)
        self.asset.save(run.asset_file)

    @staticmethod
    def load(run: RunFolder, device: torch.device, *, calibrated: bool = True) -> "Decomposition":
        """Read what `save` wrote; raise `InputError` when Phase I has not finished in this run.

        calibrated: apply the run's calibration (`models.calibration`), where it has one; training goes on
        without.
        """
        if not run.asset_file.exists():
            root = run.scene()["root"] if run.scene_file.is_file() else "SCENE"
            raise InputError(
                f"{run.path} has no reconstructed object yet, Phase I has not finished in it; "
                f"go on with: lightprobe train {shell_word(root)} -o {shell_word(run.path)}"
            )
        record = read_record(run)
        lights = _load_lights(_lights_file(run), set(record.cameras["train"]))
        asset = Asset.load(run.asset_file).to(device)
        environments = {name: Environment(light).to(device) for name, light in lights.items()}
        verdict = ObjectVerdict.load(run.verdict_file)
        calibration = Calibration.load(run.calibration_file) if calibrated else None
        if calibration is None:
            return Decomposition(asset, environments, record.similarity, verdict=verdict)
        factor = calibration.tensor(device)
        environments = {name: light.scaled(factor) for name, light in environments.items()}
        return Decomposition(
            calibration.applied(asset), environments, record.similarity, asset, calibration, verdict
        )


def _load_lights(path: Path, photos: set[str]) -> dict[str, Tensor]:
    """Return the light of every training photo; raise `InputError` when one is missing or no light."""
    with remedied(REMAKE):
        lights = load_tensors(path)
    if lights.keys() != photos:
        odd = sorted(lights.keys() ^ photos)[0]
        raise damaged(path, f"it and scene.json do not name the same training photos ({odd[:200]!a})", REMAKE)
    check_tensors(lights, dict.fromkeys(sorted(lights), TensorRule((6, "R", "R", 3), low=0)), path, REMAKE)
    for name, light in lights.items():
        if light.shape[1] not in LIGHT_RESOLUTIONS:
            raise damaged(
                path, f"'{name}' has {light.shape[1]} texels along an edge, not a power of two", REMAKE
            )
    return lights


def _lights_file(run: RunFolder) -> Path:
    return run.mesh_folder / LIGHTS_FILE
