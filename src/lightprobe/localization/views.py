"""What `locate` knows of an object beyond the asset: landmarks and templates, one file of the run."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import torch

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.errors import InputError
from lightprobe.core.stored import TensorRule, check_tensors, damaged, remedied
from lightprobe.localization.matching import Landmarks, find_landmarks
from lightprobe.localization.templates import LIGHTS, SIDE, Templates, make_templates, views_around
from lightprobe.models import Decomposition
from lightprobe.scene.photo import Scene

REMEDY = "delete it, and lightprobe locate makes it again from the scene's photos"
_FAR = 1e3  # radii; no camera that sees anything of the object is farther away
_LONGEST = 2**16  # pixels of a photo that landmarks are found in
_LARGE = 100.0  # no logarithm of an appearance is larger
_RULES = {
    "descriptor": TensorRule(("N", 64), torch.float16, low=-1.01, high=1.01),
    "place": TensorRule(("N", 2), low=0, high=_LONGEST),
    "size": TensorRule(("V", 2), torch.int32, low=1, high=_LONGEST),
    "point": TensorRule(("N", 3), low=-_FAR, high=_FAR),
    "side": TensorRule(("V", 3), low=-1.001, high=1.001),
    "photo": TensorRule(("N",), torch.int32, below="V"),
    "camera": TensorRule(("T", 4, 4), low=-_FAR, high=_FAR),
    "tangent": TensorRule(("T",), low=1e-4, high=1e3),
    "mask": TensorRule(("T", SIDE, SIDE), torch.uint8, high=1),
    "mean": TensorRule(("T", 3, SIDE, SIDE), torch.float16, low=-_LARGE, high=_LARGE),
    "lights": TensorRule(("T", LIGHTS, SIDE, SIDE), torch.float16, low=-_LARGE, high=_LARGE),
    "edges": TensorRule(("T", 2, SIDE, SIDE), torch.float16, low=-_LARGE, high=_LARGE),
}


@dataclass(frozen=True)
class KnownViews:
    """An object as it has been seen, and as it can look from many sides."""

    landmarks: Landmarks
    templates: Templates
    focal: float  # median focal length of the training photos, in their longer side

    @staticmethod
    def of(
        decomposition: Decomposition,
        scene: Scene,
        on_photo: Callable[[int, int], None] = lambda done, total: None,
    ) -> "KnownViews":
        """Return the views of an object from its training photos; `on_photo` as in `find_landmarks`.

        Raises `ConfigError` without the extra `photos`.
        """
        asset, similarity = decomposition.asset, decomposition.similarity
        landmarks = find_landmarks(asset, scene.train, similarity, on_photo)
        cameras = [photo.camera.normalised(similarity) for photo in scene.train]
        templates = make_templates(asset, views_around(cameras), asset.mesh.vertices.device)
        focal = sorted(camera.fx / max(camera.width, camera.height) for camera in cameras)[len(cameras) // 2]
        return KnownViews(landmarks, templates, focal)

    def save(self, path: Path) -> None:
        """Write the views as one safetensors file."""
        focal = {"focal": torch.tensor([self.focal], dtype=torch.float64)}
        save_tensors(path, vars(self.landmarks) | vars(self.templates) | focal)

    @staticmethod
    def load(path: Path) -> "KnownViews":
        """Read what `save` wrote; raise `InputError` when it cannot be used."""
        with remedied(REMEDY):
            tensors = load_tensors(path)
            if "place" not in tensors:
                raise InputError(f"{path} was made by an older version")
        check_tensors(tensors, _RULES, path, REMEDY)
        check_tensors(tensors, {"focal": TensorRule((1,), torch.float64, 1e-3, 1e5)}, path, REMEDY)
        if bool((tensors["photo"].diff() < 0).any()):
            raise damaged(path, "its landmarks are not in the order of their photos", REMEDY)
        landmarks = Landmarks(*(tensors[field.name] for field in fields(Landmarks)))
        templates = Templates(*(tensors[field.name] for field in fields(Templates)))
        return KnownViews(landmarks, templates, float(tensors["focal"]))
