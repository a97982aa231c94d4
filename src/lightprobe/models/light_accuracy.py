"""How well an object tells of its light: what predictions for simulated photos of it turned out to be.

An object that is matte, seen small or mostly in its own shadow tells little of its light, however well it was
reconstructed. `evaluation.simulated_photos` measures how little at the end of training, under the same lights
for every object, and this keeps it: for people, and for the confidence of every map that is predicted with
the object.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightprobe.core.config.prediction import Method
from lightprobe.core.files import write_json
from lightprobe.core.run import RETRAIN
from lightprobe.core.stored import damaged, read_object

_FILE = "light_accuracy.json"
_MOST = 100.0  # no error of a map is larger, and no expected one wrong by more
_LEAST_SCALE = 1e-3  # a smaller one would make every map certain
_UNKNOWN = "unknown"  # key of the reason why nothing could be measured
_SCALES = ("fitted_scale", "estimated_scale")


@dataclass(frozen=True)
class LightAccuracy:
    """Means over simulated photos of the maps that one method predicted, and two factors for the confidence."""

    method: str  # the run's default, but one of descent from scratch (minutes a photo) is represented by the best other
    photos: int
    log_error: float  # root mean square of ln radiance's, by direction and channel, after one factor per map
    spheres: tuple[float, float, float]  # si-RMSE of the diffuse, matte and mirror sphere
    fitted_scale: float  # error over what the confidence expects of maps that were fitted to their photo
    estimated_scale: float  # the same of maps that never met the photo's pixels

    @property
    def sentence(self) -> str:
        """What to expect of the maps that are predicted with the object."""
        diffuse, matte, mirror = self.spheres
        return (
            f"On {self.photos} simulated photos of the object the directions of the predicted map were off by "
            f"{math.exp(self.log_error):.2f} times on average, after one factor for all, and the spheres' si-RMSE "
            f"(diffuse, matte, mirror) was {diffuse:.3f}, {matte:.3f} and {mirror:.3f}."
        )

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value: the measures and the sentence."""
        return {**vars(self), "spheres": list(self.spheres), "sentence": self.sentence}

    def save(self, folder: Path) -> None:
        """Write `folder`/light_accuracy.json, atomically."""
        write_json(Path(folder) / _FILE, self.to_json())

    @staticmethod
    def save_unknown(folder: Path, reason: str) -> None:
        """Write into `folder`/light_accuracy.json that nothing could be measured, and why."""
        write_json(Path(folder) / _FILE, {_UNKNOWN: reason})

    @staticmethod
    def is_decided(folder: Path) -> bool:
        """Return whether the folder of a model holds one, or that nothing could be measured."""
        return (Path(folder) / _FILE).exists()

    @staticmethod
    def load(folder: Path) -> "LightAccuracy | None":
        """Return what a model's folder holds, None where it is unknown; raise `InputError` for a damaged file."""
        path = Path(folder) / _FILE
        if not LightAccuracy.is_decided(folder):
            return None
        value = read_object(path, RETRAIN)
        if _UNKNOWN in value:
            return None
        method, photos, spheres = value.get("method"), value.get("photos"), value.get("spheres")
        if method not in list(Method):
            raise damaged(path, "'method' is none", RETRAIN)
        if type(photos) is not int or photos < 1:
            raise damaged(path, "'photos' is no count", RETRAIN)
        if not isinstance(spheres, list) or len(spheres) != 3:
            raise damaged(path, "'spheres' is not three errors", RETRAIN)
        diffuse, matte, mirror = (_number(path, "spheres", sphere, 0) for sphere in spheres)
        error = _number(path, "log_error", value.get("log_error"), 0)
        fitted, estimated = (_number(path, name, value.get(name), _LEAST_SCALE) for name in _SCALES)
        return LightAccuracy(str(method), photos, error, (diffuse, matte, mirror), fitted, estimated)


def _number(path: Path, name: str, value: Any, least: float) -> float:
    if type(value) not in (int, float) or not least <= value <= _MOST:
        raise damaged(path, f"'{name}' is not from {least:g} to {_MOST:g}", RETRAIN)
    return float(value)
