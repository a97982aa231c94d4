import math

import numpy as np
import pytest
import torch

from lightprobe.light import cubemap, equirect

AXES = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}


def lookup(cube: torch.Tensor, direction: torch.Tensor) -> torch.Tensor:
    index, weight = cubemap.bilinear_taps(direction, cube.shape[1])
    return (cube.reshape(-1, cube.shape[-1])[index.long()] * weight[..., None]).sum(1)


@pytest.mark.parametrize("resolution", [4, 16, 33])
def test_solid_angles_cover_the_sphere(resolution):
    assert float(cubemap.solid_angles(resolution).double().sum()) == pytest.approx(4 * math.pi, rel=1e-5)
    assert float(equirect.solid_angles(resolution).double().sum()) == pytest.approx(4 * math.pi, rel=1e-3)


def test_faces_are_ordered_x_y_z():
    centers = cubemap.directions(1).reshape(6, 3)
    assert torch.allclose(centers, torch.tensor(list(AXES.values()), dtype=torch.float32), atol=1e-6)


def test_texels_lie_on_the_faces_as_opengl_s_do():
    """The table of faces in OpenGL's specification: what runs along columns (s) and rows (t), over the major
    axis.
    """
    table = {0: "-z -y", 1: "+z -y", 2: "+x +z", 3: "+x -z", 4: "+x -y", 5: "-x -y"}
    directions = cubemap.directions(4)
    for face, axes in table.items():
        s, t = (torch.tensor(AXES[axis], dtype=torch.float32) for axis in axes.split())
        assert (directions[face] @ s).diff(dim=1).min() > 0.1
        assert (directions[face] @ t).diff(dim=0).min() > 0.1


def test_looking_up_the_directions_themselves_returns_them_even_across_faces():
    cube = cubemap.directions(32)
    random = torch.randn(4000, 3, generator=torch.Generator().manual_seed(0))
    random = torch.nn.functional.normalize(random, dim=1)
    edges = torch.nn.functional.normalize(
        torch.tensor([[1.0, 1, 0.2], [1, -1, 0.9], [0.1, 1, 1], [1, 1, 1]]), dim=1
    )
    for directions in (random, edges):
        assert (lookup(cube, directions) - directions).norm(dim=1).max() < 0.05


def test_lookup_is_continuous_over_an_edge():
    cube = torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(1))
    a, b = (torch.nn.functional.normalize(torch.tensor([[1.0, s, 0.3]]), dim=1) for s in (1 - 1e-5, 1 + 1e-5))
    assert (lookup(cube, a) - lookup(cube, b)).abs().max() < 1e-3


def test_a_marked_map_has_each_colour_where_the_convention_says():
    """The convention of Blender's environment texture: centre +x, a quarter from the left +y, the border -x,
    top +z.
    """
    height = 64
    d = equirect.directions(height)
    middle, width = height // 2, 2 * height
    spots = {
        "+x": (middle, height),
        "+y": (middle, width // 4),
        "-y": (middle, 3 * width // 4),
        "-x": (middle, 0),
    }
    for name, (row, column) in spots.items():
        assert (d[row, column] - torch.tensor(AXES[name], dtype=torch.float32)).norm() < 0.06
    assert d[0, :, 2].min() > 0.99
    assert d[-1, :, 2].max() < -0.99


def test_round_trip_keeps_six_colours_in_place():
    d = cubemap.directions(16)
    cube = torch.cat([d.clamp(min=0), (-d).clamp(min=0)], -1)
    there = equirect.from_cubemap(cube, 64)
    back = equirect.to_cubemap(there, 16)
    assert (back - cube).abs().max() < 0.06
    expected = equirect.directions(64)
    assert (there[..., :3] - expected.clamp(min=0)).abs().max() < 0.06


def test_a_large_map_is_taken_in_bands(monkeypatch):
    map = torch.rand(64, 128, 3, generator=torch.Generator().manual_seed(0))
    whole = equirect.to_cubemap(map, 8)
    monkeypatch.setattr(equirect, "_AT_ONCE", 3 * 128 + 5)  # bands that cut through texels
    seen = []
    samples = equirect._face_samples
    monkeypatch.setattr(equirect, "_face_samples", lambda *a: seen.append(len(a[2])) or samples(*a))
    assert torch.allclose(equirect.to_cubemap(map, 8), whole, rtol=1e-6)
    assert set(seen) == {3, 128 % 3}


def test_a_one_texel_sun_keeps_its_flux():
    height = 64
    sun = torch.zeros(height, 2 * height, 3)
    sun[20, 37] = 5000.0
    flux = float((sun[..., 0] * equirect.solid_angles(height)).sum())
    cube = equirect.to_cubemap(sun, 16)
    assert float((cube[..., 0] * cubemap.solid_angles(16)).sum()) == pytest.approx(flux, rel=0.01)
    where = cubemap.directions(16).reshape(-1, 3)[cube[..., 0].argmax()]
    assert float((where * equirect.directions(height)[20, 37]).sum()) > math.cos(math.radians(8))


def test_the_cube_has_24_rotations_and_24_reflections():
    index, handedness = cubemap.symmetries(4, torch.device("cpu"))
    texels = cubemap.exact_directions(4).reshape(-1, 3)
    assert int((handedness == 1).sum()) == int((handedness == -1).sum()) == 24
    assert len(index.unique(dim=0)) == 48
    for turn, hand in zip(index, handedness, strict=True):
        matrix = torch.linalg.lstsq(texels, texels[turn]).solution
        torch.testing.assert_close(matrix @ matrix.T, torch.eye(3, dtype=torch.float64))
        torch.testing.assert_close(texels @ matrix, texels[turn])
        assert torch.linalg.det(matrix).round() == hand


def test_tap_weights_follow_their_direction():
    direction = torch.nn.functional.normalize(
        torch.tensor([[0.3, -0.5, 0.9], [1.0, 0.2, -0.1]]), dim=1
    ).double()
    cube = torch.from_numpy(np.random.default_rng(2).random((6, 8, 8, 3)))
    direction.requires_grad_()
    assert torch.autograd.gradcheck(lambda d: lookup(cube, d), (direction,), eps=1e-6, atol=1e-5)
