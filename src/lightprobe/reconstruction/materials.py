"""The few materials that an object is made of, found as groups of surface points that are alike."""

import copy
import warnings
from dataclasses import dataclass

import scipy
import torch
from torch import Tensor

from lightprobe.reconstruction.scaled_material import ScaledMaterial

COUNT = 4  # materials that an object is sorted into; one of fewer has some without points
_ROUNDS = 30  # of sorting
_ALIKE = 0.7, 2.0, 2.0  # weights of the logarithm of colours, of roughness and of metallic
_DARKEST = 0.02  # linear colour below which all are alike


@dataclass(frozen=True)
class Materials:
    """Which surface point is of which material."""

    reference: ScaledMaterial  # as it was when they were found
    centres: Tensor  # (COUNT, 5) of the points' features

    @staticmethod
    @torch.no_grad()
    def of(material: ScaledMaterial, points: Tensor, seed: int) -> "Materials":
        """Sort points (N, 3) by colour, roughness and metallic; deterministic."""
        reference = copy.deepcopy(material)
        features = _features(reference(points)).cpu().numpy()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # materials without points are no harm
            centres = scipy.cluster.vq.kmeans2(features, COUNT, iter=_ROUNDS, minit="++", seed=seed)[0]
        return Materials(reference, torch.from_numpy(centres).to(points))

    @torch.no_grad()
    def at(self, points: Tensor) -> Tensor:
        """Return which material points (N, 3) are of, (N,) int64 below COUNT."""
        return torch.cdist(_features(self.reference(points)), self.centres).argmin(1)

    def shares(self, points: Tensor) -> list[float]:
        """Return the share of points (N, 3) that each material has."""
        return (torch.bincount(self.at(points), minlength=COUNT) / len(points)).tolist()


@dataclass(frozen=True)
class HeldMetallic:
    """The metallic of one material, given and not fitted: one of `ScaledMaterial.held`."""

    materials: Materials
    number: int
    metallic: float

    def __call__(self, points: Tensor, material: Tensor) -> Tensor:
        """Return the material (N, 8) of points (N, 3) with the given value."""
        here = (self.materials.at(points) == self.number)[:, None]
        metallic = torch.where(here, self.metallic, material[:, 4:5])
        return torch.cat([material[:, :4], metallic, material[:, 5:]], 1)


def _features(material: Tensor) -> Tensor:
    """Return what materials (N, >= 5) are compared by, (N, 5)."""
    color, roughness, metallic = material[:, :3], material[:, 3:4], material[:, 4:5]
    of_color, of_roughness, of_metallic = _ALIKE
    return torch.cat(
        [of_color * (color + _DARKEST).log(), of_roughness * roughness, of_metallic * metallic], 1
    )
