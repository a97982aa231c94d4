"""A glossier start for an object that is nearly finished.

Two explanations of photos under unknown lights stand side by side: a rough surface under sharp lights, and a
glossy one under dimmer, blurred ones. A fit goes to that from which it starts, and while the shape is wrong
only a rough surface explains anything: what is wrong with normals blurs reflections. A glossy surface then
never comes back. The other way round is easy: photos ask for a matte surface to be rough wherever it starts.
So once the shape is nearly right the fit starts over from a glossier material, under lights of its own.
"""

import copy

import torch

from lightprobe.light.prefilter import MIN_ROUGHNESS
from lightprobe.reconstruction.material_field import ScaledMaterial, fit_field
from lightprobe.reconstruction.trials.schedule import refit_steps
from lightprobe.reconstruction.trials.trial import Trial, TrialPhotos

_SHARE = 0.5  # of its roughness that a material starts over with
_SOLVES = 8  # of each light before


def glossier_start(photos: TrialPhotos, material: ScaledMaterial) -> Trial | None:
    """Return the `material` fitted anew from half its roughness, and its lights; None without photos."""
    if not photos.samples:
        return None
    points, glossy = photos.points(), copy.deepcopy(material)
    with torch.no_grad():
        wanted = material(points)
        wanted[:, 3] = (_SHARE * wanted[:, 3]).clamp(min=MIN_ROUGHNESS)
    fit_field(glossy, points, wanted, photos.seed)
    trial = Trial(glossy, photos, refit_steps(material.config), solves=_SOLVES)
    trial.settle(material)
    return trial
