"""Whether there is a cavity where masks show none: lids that may close one are opened, and stay so where
photos ask.

No small step of the surface leads from a closed vessel to an open one, and materials and normal offsets hide
what they can of the difference. So parts of the surface that may be lids, and are explained worse than the
rest, are opened to several depths and with walls of several thicknesses, and the material is fitted to each,
as it is to the closed surface. Where there is no cavity the lid's pixels are explained worse by far: what
shows through an opening depends on where the camera stands.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.trials.evidence import FEWEST_PHOTOS, Bar, Evidence, standard_error
from lightprobe.reconstruction.trials.lids import (
    ClosedSurface,
    LatticeSolid,
    Lid,
    find_lids,
    hollowed,
    without_voids,
)
from lightprobe.reconstruction.trials.schedule import refit_steps
from lightprobe.reconstruction.trials.trial import PHOTOS, PassPhotos, Sample, Trial, TrialPhotos
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under

_WALLS = (1.0, 1.3, 1.75, 3.0, 5.0)  # lattice cells, tried with the first depth
_DEPTHS = (1.0, 0.5, 2.0)  # radii of the lid; the others are tried with the best wall
_BAR = Bar(sure=2.5, least=0.12)  # higher than usual: one of several attempts, each with a shape of its own
_SUSPECT = 1.5  # times the error of the rest, from which on a lid is tried
_DOUBTFUL = 2.0  # times that error, from which on the surface waits for the trial to follow its texture
_TRIED = 3  # lids at most, the worst first
_SEEN = 0.03  # share of the object's pixels in a photo that a lid needs there
_COVERED = 0.999  # share of the masks that stays covered, or the wall has holes: too thin for the lattice
_BEHIND = 2.0  # lattice cells that a pixel's surface moves by if it is to judge a cavity
_FEWEST_PIXELS = 20  # of those, among the ones that a trial draws from a photo


@dataclass(frozen=True)
class Opening:
    """A surface with cavities, and the material and lights fitted to it."""

    distance: Tensor  # (L,) float32 at the lattice's vertices, inside < 0
    trial: Trial


@dataclass(frozen=True)
class _Suspect:
    """A lid, and the photos that show it."""

    lid: Lid
    targets: list[Target]
    shown: dict[str, Tensor]  # photo name -> (N,) bool: which of its pixels show the lid
    excess: float  # its error over that of the rest of the object

    def rows(self, sample: Sample) -> Tensor:
        """Return the rows (K,) int64 of a sample's pixels that show the closed surface's lid."""
        return self.shown[sample.name][sample.pixels.pixel].nonzero()[:, 0]


def best_opening(model: LatticeModel, photos: PassPhotos) -> Opening | None:
    """Return the model's surface with the cavities that photos ask for, None where they ask for none.

    The model and the lights stay as they are. Deterministic.
    """
    model, found = _without_voids(model), None
    surface = _surface(model)
    for suspect in _suspects(model, surface, photos):
        opened = _opened(model, surface, suspect, photos)
        if opened is not None:
            model, found = opened
    return found


def has_doubtful_lid(model: LatticeModel, photos: PassPhotos) -> bool:
    """Return whether a part of the surface that may be a lid is explained so badly that it may well be one."""
    model = _without_voids(model)
    return any(suspect.excess > _DOUBTFUL for suspect in _suspects(model, _surface(model), photos))


@torch.no_grad()
def _suspects(model: LatticeModel, surface: ClosedSurface, photos: PassPhotos) -> list[_Suspect]:
    """Return the lids that are explained worse than the rest of the object, the worst first."""
    lids, lights = find_lids(surface), photos.lights
    of_lid = [torch.from_numpy(lid.vertices[surface.faces].all(1)).to(lights.maps[0].device) for lid in lids]
    errors: list[list[tuple[float, float]]] = [[] for _ in lids]
    seen: list[dict[str, Tensor]] = [{} for _ in lids]
    for target, gbuffer in photos.shown(model) if lids else ():
        pixels = gbuffer.select(target.inside(gbuffer.pixel))
        image = shade_under(pixels, lights.maps[lights.index[target.name]].detach())
        for lid_faces, error, shown in zip(of_lid, errors, seen, strict=True):
            here = lid_faces[pixels.face]
            if float(here.float().mean()) >= _SEEN and not bool(here.all()):
                picture = torch.zeros_like(target.alpha, dtype=torch.bool)
                picture[pixels.pixel[here]] = True
                shown[target.name] = picture
                error.append((_error(image, target, pixels, here), _error(image, target, pixels, ~here)))
    suspects = []
    for lid, error, shown in zip(lids, errors, seen, strict=True):
        if len(error) >= FEWEST_PHOTOS:
            own, rest = (sum(part) for part in zip(*error, strict=True))
            targets = [target for target in photos.targets if target.name in shown]
            suspects.append(_Suspect(lid, targets, shown, own / max(rest, 1e-9)))
    suspects = [suspect for suspect in suspects if suspect.excess > _SUSPECT]
    return sorted(suspects, key=lambda suspect: -suspect.excess)[:_TRIED]


def _error(image: Tensor, target: Target, pixels: GBuffer, chosen: Tensor) -> float:
    """Return the displayed error of some of the pixels (P,) bool of a photo that is shown as `image` (P, 3)."""
    at = pixels.pixel[chosen]
    return float(displayed_error(image[chosen], target.color[at], target.clipped[at]))


def _opened(
    model: LatticeModel, surface: ClosedSurface, suspect: _Suspect, photos: PassPhotos
) -> tuple[LatticeModel, Opening] | None:
    """Return a copy of the model with the best cavity behind a lid, None where no cavity is better."""
    photos = replace(photos, targets=suspect.targets).evenly(PHOTOS)
    closed = _Fitted.of(model, photos)
    whole_lid = Evidence.of(closed.trial, suspect.rows, _FEWEST_PIXELS)

    def attempts(sizes: Iterable[tuple[float, float]]) -> Iterator[_Attempt]:
        for wall, depth in sizes:
            hollow = _with_cavity(model, surface, suspect.lid, wall=wall, depth=depth)
            if hollow is None:
                continue
            opened = _Fitted.of(hollow, photos)

            def inside(sample: Sample, opened: _Fitted = opened) -> Tensor:
                rows = suspect.rows(sample)
                return rows[opened.moved(closed, sample, rows) > _BEHIND * model.lattice.cell]

            before = Evidence.of(closed.trial, inside, _FEWEST_PIXELS)
            evidence = Evidence.of(opened.trial, inside, _FEWEST_PIXELS)
            if opened.covered >= _COVERED * closed.covered and evidence.explains_part(before, _BAR):
                gains = Evidence.of(opened.trial, suspect.rows, _FEWEST_PIXELS).own_gain(whole_lid)
                yield _Attempt(wall, hollow, opened.trial, before, evidence, gains)

    first, *other_depths = _DEPTHS
    better = list(attempts((wall, first) for wall in _WALLS))
    if better:
        wall = _by_preference(better)[0].wall
        better += attempts((wall, depth) for depth in other_depths)
    for attempt in _by_preference(better):
        if attempt.evidence.speaks_for_change(attempt.before, _BAR):
            attempt.model.material.take_over(attempt.trial.material)  # the next lid's trials start from it
            return attempt.model, Opening(attempt.model.distances().detach(), attempt.trial)
    return None


@dataclass(frozen=True)
class _Attempt:
    """A cavity that explains the lid's pixels better."""

    wall: float  # lattice cells
    model: LatticeModel
    trial: Trial
    before: Evidence  # of the closed surface, by the pixels that show the cavity
    evidence: Evidence
    gains: Tensor  # (K,) of photos, for the whole lid: attempts are compared by the same pixels

    @property
    def gain(self) -> float:
        """The mean gain over photos."""
        return float(self.gains.mean())


def _by_preference(attempts: Sequence[_Attempt]) -> list[_Attempt]:
    """Return the attempts, the best first.

    Of those that are as good as the one with the most gain, within its standard error, the thinnest wall: a
    rim that is too wide stays so, as it looks like the lid that was there.
    """
    order = sorted(attempts, key=lambda attempt: -attempt.gain)
    tied = order[0].gain - standard_error(order[0].gains) if order else 0.0
    return sorted(order, key=lambda a: (a.gain < tied, a.wall if a.gain >= tied else -a.gain))


def _with_cavity(
    model: LatticeModel, surface: ClosedSurface, lid: Lid, *, wall: float, depth: float
) -> LatticeModel | None:
    """Return a copy of the model with a cavity behind a lid, None where the walls leave no room for one.

    wall: in lattice cells; depth: in radii of the lid.
    """
    solid = _solid(model)
    hollow = hollowed(solid, surface, lid, wall=wall * solid.cell, depth=depth * lid.radius)
    return None if np.array_equal(hollow, solid.distance) else _reshaped(model, hollow)


def _without_voids(model: LatticeModel) -> LatticeModel:
    """Return the model, or a copy without its voids, which a cavity would keep away from as from a surface."""
    solid = _solid(model)
    filled = without_voids(solid, model.lattice.boundary.cpu().numpy())
    return model if np.array_equal(filled, solid.distance) else _reshaped(model, filled)


def _reshaped(model: LatticeModel, distance: np.ndarray) -> LatticeModel:
    """Return a copy of the model with signed distances (L,) float32."""
    copied = copy.deepcopy(model)
    copied.reshape(torch.from_numpy(distance).to(model.lattice.vertices.device))
    return copied


def _solid(model: LatticeModel) -> LatticeSolid:
    """Return what the model's surface bounds."""
    parts = (model.distances(), model.positions(), model.lattice.edges)
    distance, points, edges = (part.detach().cpu().numpy() for part in parts)
    return LatticeSolid(distance, points, edges, model.lattice.cell)


def _surface(model: LatticeModel) -> ClosedSurface:
    """Return the model's present surface."""
    vertices, faces = model.extract()
    normals = vertex_normals(torch.from_numpy(vertices), torch.from_numpy(faces)).numpy()
    return ClosedSurface(vertices, normals, faces)


@dataclass(frozen=True)
class _Fitted:
    """A material fitted to a surface, and where the photos show this."""

    trial: Trial
    covered: int  # how many of the photos' pixels the surface covers
    places: dict[str, Tensor]  # photo name -> (H * W, 3) points of the surface, nan where there is none

    @staticmethod
    def of(model: LatticeModel, photos: PassPhotos) -> "_Fitted":
        """Return the model's material fitted on its surface."""
        samples, covered, places = [], 0, {}
        for target, gbuffer in photos.shown(model):
            samples.append(Sample.of(target, gbuffer, photos.seed))
            covered += len(target.inside(gbuffer.pixel))
            place = gbuffer.position.new_full((gbuffer.height * gbuffer.width, 3), torch.nan)
            place[gbuffer.pixel] = gbuffer.position
            places[target.name] = place
        material, steps = copy.deepcopy(model.material), refit_steps(model.config)
        seen = TrialPhotos(samples, photos.lights, photos.seed)
        return _Fitted(Trial(material, seen, steps), covered, places)

    def moved(self, other: "_Fitted", sample: Sample, rows: Tensor) -> Tensor:
        """Return how far the surface is from another one, (K,), at the rows (K,) int64 of a sample's pixels.

        The distance is nan where one of the surfaces is not seen.
        """
        at = sample.pixels.pixel[rows]
        return (self.places[sample.name][at] - other.places[sample.name][at]).norm(dim=1)
