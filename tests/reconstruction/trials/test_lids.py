"""Lids are found on a vessel's hull, and what is hollowed out behind one is the vessel's inside."""

import numpy as np
import pytest
import torch

from lightprobe.geometry.marching_tetrahedra import Crossing, marching_tetrahedra
from lightprobe.geometry.mesh import is_closed, vertex_normals
from lightprobe.geometry.tet_lattice import build_lattice
from lightprobe.reconstruction.trials.lids import (
    ClosedSurface,
    LatticeSolid,
    Lid,
    find_lids,
    hollowed,
    without_voids,
)

CELL, RADIUS, HEIGHT = 0.05, 0.6, 0.8
LATTICE = build_lattice(np.ones((48,) * 3, bool), np.full(3, -24 * CELL), CELL)
POINTS = LATTICE.vertices.numpy()


def cylinder(points: np.ndarray) -> np.ndarray:
    """Signed distance, or a bound of it, of a closed upright cylinder."""
    return np.maximum(np.hypot(points[:, 0], points[:, 1]) - RADIUS, np.abs(points[:, 2]) - HEIGHT).astype(
        np.float32
    )


def surface(distance: np.ndarray) -> ClosedSurface:
    """The zero set of distances on the lattice."""
    tensor = torch.from_numpy(distance)
    vertices, faces = marching_tetrahedra(LATTICE, Crossing.of(LATTICE, tensor), LATTICE.vertices, tensor)
    return ClosedSurface(vertices.numpy(), vertex_normals(vertices, faces).numpy(), faces.numpy())


def top_lid(closed: ClosedSurface) -> Lid:
    """The lid that lies highest."""
    return max(find_lids(closed), key=lambda lid: closed.vertices[lid.vertices, 2].mean())


def hollow(distance: np.ndarray | None = None, **sizes) -> np.ndarray:
    """A solid, by default the cylinder, with a cavity behind its top."""
    distance = cylinder(POINTS) if distance is None else distance
    closed = surface(distance)
    return hollowed(
        LatticeSolid(distance, POINTS, LATTICE.edges.numpy(), CELL), closed, top_lid(closed), **sizes
    )


def at(distance: np.ndarray, *point: float) -> float:
    """The distance at the lattice vertex nearest to a point."""
    return float(distance[np.linalg.norm(POINTS - np.array(point), axis=1).argmin()])


def test_top_and_bottom_are_lids_of_the_discs_radius():
    closed = surface(cylinder(POINTS))
    lids = find_lids(closed)
    heights = [closed.vertices[lid.vertices, 2] for lid in lids]
    top = [lid for lid, z in zip(lids, heights, strict=True) if z.min() > HEIGHT - 2 * CELL]
    bottom = [lid for lid, z in zip(lids, heights, strict=True) if z.max() < 2 * CELL - HEIGHT]
    assert len(top) == len(bottom) == 1
    assert top[0].radius == pytest.approx(RADIUS, rel=0.12)  # smoothed normals leave the edge out
    assert [lid.radius for lid in lids] == sorted((lid.radius for lid in lids), reverse=True)


def test_a_rough_lid_has_no_gaps():
    rough = cylinder(POINTS) + 0.6 * CELL * np.sin(40 * POINTS[:, 0]) * np.sin(37 * POINTS[:, 1])
    closed = surface(rough.astype(np.float32))
    on_top = (closed.vertices[:, 2] > 0.7) & (np.hypot(closed.vertices[:, 0], closed.vertices[:, 1]) < 0.5)
    assert top_lid(closed).vertices[on_top].all()


def test_the_cavity_has_walls_and_a_floor():
    cup = hollow(wall=0.15, depth=3.0)
    assert at(cup, 0, 0, 0) > 0  # the middle is open
    assert at(cup, 0, 0, HEIGHT) > 0  # and so is the lid
    assert at(cup, 0, 0, -HEIGHT + 0.05) < 0  # the floor stays
    assert at(cup, RADIUS - 0.05, 0, 0) < 0  # and the wall
    assert at(cup, 0, 0, -HEIGHT + 0.25) > 0  # the floor is no thicker than the wall
    inside = surface(cup)
    assert is_closed(torch.from_numpy(inside.vertices), torch.from_numpy(inside.faces))


def test_the_inside_is_as_smooth_as_the_outside():
    inside = surface(hollow(wall=0.15, depth=3.0))
    across = np.hypot(inside.vertices[:, 0], inside.vertices[:, 1])
    wall = (across < RADIUS - 0.1) & (np.abs(inside.vertices[:, 2]) < 0.4)
    inwards = -inside.vertices[wall, :2] / across[wall, None]
    cosine = (inside.normals[wall, :2] * inwards).sum(1)
    assert wall.sum() > 500
    assert (
        np.degrees(np.arccos(cosine.clip(-1, 1))).mean() < 1.7
    )  # 1.9 with distances from the nearest vertices


def test_the_cavity_goes_no_deeper_than_told():
    cup = hollow(wall=0.15, depth=0.4)
    assert at(cup, 0, 0, HEIGHT - 0.3) > 0
    assert at(cup, 0, 0, HEIGHT - 0.5) < 0


@pytest.mark.slow
def test_nothing_grows_and_a_thick_wall_leaves_all_as_it_is():
    solid = cylinder(POINTS)
    assert (hollow(wall=0.15, depth=3.0) >= solid).all()
    assert np.array_equal(hollow(wall=0.7, depth=3.0), solid)


def test_pockets_without_a_way_to_the_lid_stay_closed():
    # A dumb-bell: its waist is thinner than two walls, so that the lower half has no way out.
    radius = np.where(np.abs(POINTS[:, 2]) < 0.2, 0.12, RADIUS)
    distance = np.maximum(np.hypot(POINTS[:, 0], POINTS[:, 1]) - radius, np.abs(POINTS[:, 2]) - HEIGHT)
    opened = hollow(distance.astype(np.float32), wall=0.15, depth=3.0)
    assert at(opened, 0, 0, 0.5) > 0
    assert at(opened, 0, 0, -0.5) < 0


def test_voids_are_filled_and_openings_are_not():
    cup = hollow(wall=0.3, depth=3.0)
    void = np.linalg.norm(POINTS - [0, 0, -HEIGHT + 0.15], axis=1) < 0.06
    assert void.any()
    solid = LatticeSolid(np.where(void, np.float32(0.01), cup), POINTS, LATTICE.edges.numpy(), CELL)
    filled = without_voids(solid, LATTICE.boundary.numpy())
    assert (filled[void] == np.float32(-CELL)).all()
    assert np.array_equal(filled[~void], cup[~void])


@pytest.mark.parametrize("radius", [0.05, 0.08])
def test_a_dent_in_a_lid_leaves_no_pillar(radius):
    beside = np.hypot(POINTS[:, 0] - 0.2, POINTS[:, 1])
    dent = np.maximum(beside - radius, 0.55 - POINTS[:, 2])  # a steep hole
    dented = np.maximum(cylinder(POINTS), -dent).astype(np.float32)
    cup = hollow(dented, wall=0.15, depth=3.0)
    around = (beside < radius + 0.15) & (np.abs(POINTS[:, 2]) < 0.5)
    assert (cup[around] > 0).all()


@pytest.mark.parametrize("radius", [0.06, 0.12])
def test_a_knob_is_no_part_of_the_lid_it_stands_on(radius):
    across = np.hypot(POINTS[:, 0] - 0.2, POINTS[:, 1])
    knob = np.maximum(across - radius, np.abs(POINTS[:, 2] - 0.8) - 0.25)
    closed = surface(np.minimum(cylinder(POINTS), knob).astype(np.float32))
    heights = closed.vertices[:, 2]
    lid = max(find_lids(closed), key=lambda lid: heights[lid.vertices].max())
    assert heights[lid.vertices].max() < HEIGHT + 1.5 * CELL
    assert not lid.vertices[heights > HEIGHT + 2 * CELL].any()


def test_a_solid_that_is_all_lid_stays_as_it_is():
    closed = surface(cylinder(POINTS))
    lid = Lid(np.ones(len(closed.vertices), bool), RADIUS)
    solid = LatticeSolid(cylinder(POINTS), POINTS, LATTICE.edges.numpy(), CELL)
    assert hollowed(solid, closed, lid, wall=0.1, depth=1.0) is solid.distance
