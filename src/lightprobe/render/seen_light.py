"""What photos show of the light around the object, by direction."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.resize import resize_light
from lightprobe.render.surface import from_center
from lightprobe.scene.background import Background
from lightprobe.scene.camera import Camera
from lightprobe.scene.support import SupportPlane

_DARKEST = 1e-3  # radiance that exposures are compared by at least
_ROUNDS = 60  # of exposures and light in turn
_USUAL = 0.02  # difference in ln radiance between what two photos show at one place


@dataclass(frozen=True)
class SeenLight:
    """What backgrounds show, on a cubemap in the axes of the scene."""

    radiance: Tensor  # (6, R, R, 3) linear mean over the seen part of each texel, in the photo's exposure
    share: Tensor  # (6, R, R) in [0, 1], how much of each texel is seen
    clipped: Tensor  # (6, R, R, 3) bool: the radiance is a lower bound

    def divided(self, factor: Tensor) -> "SeenLight":
        """Return the same light with its radiance divided by `factor`, () or (3,) > 0."""
        return replace(self, radiance=self.radiance / factor)

    @staticmethod
    def of(
        background: Background, resolution: int, device: torch.device, support: SupportPlane | None = None
    ) -> "SeenLight":
        """Gather the pixels of a background by the directions that they look at.

        support: the plane that the object stands on, for a background whose camera is in the normalised frame.
        What is seen of it is gathered by its direction from the object's centre.
        """
        row, column = np.nonzero(background.seen)
        direction, angle = _rays(background.camera, row, column)
        if support is not None:
            direction, angle = _from_center(background.camera.position, direction, angle, support)
        texel = cubemap.nearest_texel(torch.from_numpy(direction), resolution)
        parts = background.color[row, column], background.clipped[row, column], np.ones((len(row), 1))
        values = np.concatenate(parts, 1)
        total = torch.zeros(6 * resolution**2, 7, dtype=torch.float64)
        total.index_add_(0, texel, torch.from_numpy(values * angle[:, None]))
        mean = (total[:, :6] / total[:, 6:].clamp_min(1e-12)).reshape(6, resolution, resolution, 6)
        share = total[:, 6].reshape(6, resolution, resolution) / cubemap.exact_solid_angles(resolution)
        share = share.clamp(max=1).float().to(device)
        return SeenLight(mean[..., :3].float().to(device), share, (mean[..., 3:] > 0).to(device))

    def resized(self, resolution: int) -> "SeenLight":
        """Return the same light at another resolution, as `resize_light` does it."""
        share = resize_light(self.share[..., None].expand_as(self.radiance), resolution)
        seen = self.share[..., None]
        radiance = resize_light(self.radiance * seen, resolution) / share.clamp(min=1e-12)
        clipped = resize_light(self.clipped * seen, resolution) > 0
        return SeenLight(radiance, share[..., 0], clipped)

    @staticmethod
    def joined(parts: Sequence["SeenLight"], exposures: Tensor) -> "SeenLight":
        """Return what photos of one light show, in the first one's exposure; `exposures` (N,) relative to it.

        A texel has the mean of the photos that show it unclipped; where none does, the largest lower bound.
        """
        share = torch.stack([part.share for part in parts])
        pairs = zip(parts, exposures, strict=True)
        scaled = torch.stack([part.radiance / exposure for part, exposure in pairs])
        told = share[..., None] * ~torch.stack([part.clipped for part in parts])
        bound = torch.where(share[..., None] > 0, scaled, 0.0).amax(0)
        mean = (told * scaled).sum(0) / told.sum(0).clamp_min(1e-12)
        clipped = told.sum(0) == 0
        return SeenLight(torch.where(clipped, bound, mean), share.sum(0).clamp(max=1), clipped)


def seen_together(parts: Sequence[SeenLight]) -> list[SeenLight]:
    """Return for each of the photos of one light what all of them show of it, in this photo's exposure.

    Exposures, white balance included, are found from what several photos show, so that photos which others do not link
    to each other this way do not share what they show.
    """
    share = torch.stack([part.share[..., None] * ~part.clipped for part in parts]).flatten(1, 3)  # (N, T, 3)
    level = torch.stack([part.radiance for part in parts]).flatten(1, 3).clamp(min=_DARKEST).log()
    exposure, robust = torch.zeros(len(parts), 3).to(share), share  # exposures as logarithms
    for _ in range(_ROUNDS):
        common = (robust * (level - exposure[:, None])).sum(0) / robust.sum(0).clamp(min=1e-12)
        exposure = (robust * (level - common)).sum(1) / robust.sum(1).clamp(min=1e-12)
        # What shines, or stands nearer than is assumed, looks different from elsewhere.
        robust = share / (1 + (level - common - exposure[:, None]).abs() / _USUAL)
    shown = (share.amin(-1) > 0).float()
    linked = scipy.sparse.csgraph.connected_components((shown @ shown.T).cpu().numpy())[1]
    found = list(parts)
    for component in set(linked.tolist()):
        rows = [row for row, own in enumerate(linked) if own == component]
        joint = SeenLight.joined([parts[row] for row in rows], exposure[rows].exp())
        for row in rows:
            found[row] = joint.divided((-exposure[row]).exp())
    return found


def _rays(camera: Camera, row: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions (K, 3) that pixels look in, not normalised, and their solid angles (K,)."""
    x, y = (column + 0.5 - camera.cx) / camera.fx, -(row + 0.5 - camera.cy) / camera.fy
    angle = (x * x + y * y + 1) ** -1.5 / (camera.fx * camera.fy)
    return np.stack([x, y, -np.ones_like(x)], -1) @ camera.camera_to_world[:3, :3].T, angle


def _from_center(
    position: np.ndarray, direction: np.ndarray, angle: np.ndarray, support: SupportPlane
) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (K, 3) and solid angles (K,) as they are from the frame's origin.

    direction (K, 3), not normalised, and angle (K,): as they are from `position` (3,). From a point h above the plane an
    area of it at the distance r covers the angle area * h / r^3. Rays that do not fall meet what is far away.
    """
    above, own = float(support.height(position)), float(support.height(np.zeros(3)))
    if above <= 0 or own <= 0:
        return direction, angle
    rays, plane = torch.from_numpy(direction), torch.from_numpy(np.append(support.normal, support.offset))
    towards = from_center(rays, torch.from_numpy(position), plane).numpy()
    nearer = np.linalg.norm(direction, axis=1) / np.linalg.norm(towards, axis=1)
    return towards, np.where(direction @ support.normal < 0, angle * nearer**3 * own / above, angle)
