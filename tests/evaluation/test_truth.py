"""Scores against truth files of a few pixels, with numbers that can be worked out by hand."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch
from torch import Tensor

from lightprobe.core.config.rendering import FAST_PICTURES, RenderConfig
from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.evaluation import truth
from lightprobe.evaluation.truth import (
    MaterialScores,
    asset_scores,
    chamfer_distance,
    mesh_chamfer,
    outer_faces,
    relight_scores,
    sample_surface,
    surface_scores,
)
from lightprobe.evaluation.views import TestView
from lightprobe.imaging import write_exr, write_png
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Photo, Scene, Truth
from tests.known_scene import CPU, known_decomposition
from tests.shapes import camera_at, sphere

SQUARE = (np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
HEIGHT, WIDTH = 2, 3  # of the photo
COVERED = (1, 2, 3, 5)  # its pixels that the asset covers
MASKED = (0, 1, 3, 5)  # and those of the mask: the asset's rows 0, 2 and 3 count


@pytest.mark.slow
def test_concentric_spheres_differ_by_their_radii_in_any_unit():
    vertices, faces = sphere(4)
    larger = 7.0 * vertices + [3.0, 1.0, -2.0]
    smaller = 0.9 * 7.0 * vertices + [3.0, 1.0, -2.0]
    assert mesh_chamfer((smaller, faces), (larger, faces), count=10_000) == pytest.approx(0.1, abs=0.005)


@pytest.mark.slow
def test_what_nobody_can_see_does_not_count():
    vertices, faces = sphere(3)
    both = np.concatenate([vertices, 0.5 * vertices])
    hidden = np.concatenate([faces, faces + len(vertices)])
    assert outer_faces(both, hidden).max() < len(faces)
    assert mesh_chamfer((both, hidden), (vertices, faces)) < 0.02


def test_the_distance_is_the_mean_of_both_ways_and_either_may_be_larger() -> None:
    one, two = np.zeros((1, 3)), np.array([[0.0, 0, 0], [0, 3, 4]])
    assert chamfer_distance(one, two) == pytest.approx((0 + 2.5) / 2)
    assert chamfer_distance(two + np.array([1.0, 0, 0]), one) == pytest.approx((1 + 26**0.5) / 2 / 2 + 1 / 2)


def test_samples_follow_area_and_stay_within_their_triangle() -> None:
    """A triangle of three quarters of the area far from one of a quarter, with edges that are not at right
    angles.
    """
    vertices = np.array([[0.0, 0, 0], [3, 1, 0], [2, 3, 0], [10, 0, 5], [12, 0, 5], [10, 7 / 6, 5]])
    points = sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), count=8000, seed=2)
    here, there = points[points[:, 2] == 0], points[points[:, 2] == 5]
    assert len(here) + len(there) == 8000
    assert len(here) / 8000 == pytest.approx(0.75, abs=0.02)
    for cloud, (a, b, c) in ((here, vertices[:3]), (there, vertices[3:])):
        assert cloud.mean(0) == pytest.approx((a + b + c) / 3, abs=0.05)
        u, v = np.linalg.lstsq(np.stack([b - a, c - a], 1), (cloud - a).T, rcond=None)[0]
        assert min(u.min(), v.min()) >= -1e-9
        assert (u + v).max() <= 1 + 1e-9
        assert ((u + v) < 0.5).mean() == pytest.approx(0.25, abs=0.03)  # a similar triangle of half the size
    assert not np.array_equal(
        points, sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), count=8000, seed=3)
    )


def test_the_same_surface_is_as_far_away_however_its_faces_are_listed():
    v, f = SQUARE
    one, other = (mesh_chamfer((v, faces), SQUARE, count=2000) for faces in (f, f[::-1]))
    assert one > 0.005
    assert one == pytest.approx(other, rel=0.2)


def test_every_face_of_a_ball_can_be_seen() -> None:
    vertices, faces = sphere(2)
    assert outer_faces(vertices, faces).tolist() == list(range(len(faces)))


def srgb(linear: np.ndarray | float) -> np.ndarray:
    x = np.clip(np.asarray(linear, np.float64), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def decibels(values: np.ndarray | float, true: np.ndarray | float) -> float:
    return -10 * math.log10(float(((srgb(values) - srgb(true)) ** 2).mean()))


def seen(files: Truth, *, color: np.ndarray | None = None, **material: np.ndarray | list[float]) -> TestView:
    """Return a view of four covered pixels, of which one lies outside the mask."""
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask.view(-1)[list(MASKED)] = True
    tensors = {
        name: torch.tensor(np.asarray(values), dtype=torch.float32) for name, values in material.items()
    }
    if color is not None:
        tensors["base_color"] = torch.tensor(color, dtype=torch.float32)
    gbuffer = SimpleNamespace(pixel=torch.tensor(COVERED), height=HEIGHT, width=WIDTH, **tensors)
    photo = Photo("a", camera_at((3.0, 1, 1)), Path("a.png"), truth=files)
    return cast(TestView, SimpleNamespace(photo=photo, mask=mask, gbuffer=gbuffer))


def as_map(rows: np.ndarray, elsewhere: float = 0.77) -> np.ndarray:
    """Return a map (2, 3, C) with `rows` (4, C) at the covered pixels and a wrong value at the others."""
    values = np.full((HEIGHT * WIDTH, rows.shape[1]), elsewhere, np.float32)
    values[list(COVERED)] = rows
    return values.reshape(HEIGHT, WIDTH, -1)


def colors_scored(folder: Path, mine: np.ndarray, true: np.ndarray) -> dict[str, float]:
    write_png(folder / "color.png", as_map(true), bits=16)
    scores = MaterialScores()
    scores.add(seen(Truth(base_color=folder / "color.png"), color=mine))
    return scores.result()


MINE = np.array([[0.2, 0.4, 0.1], [0.9, 0.9, 0.9], [0.4, 0.1, 0.3], [1.3, 0.5, 0.05]])


TRUE = np.array([[0.3, 0.2, 0.1], [0.1, 0.1, 0.1], [0.2, 0.15, 0.6], [1.0, 0.25, 0.2]])


def test_base_colours_are_compared_as_displayed_where_photo_and_asset_meet(tmp_path: Path) -> None:
    scores = colors_scored(tmp_path, MINE, TRUE)
    inside = [0, 2, 3]
    assert scores["base_color_psnr"] == pytest.approx(decibels(MINE[inside], TRUE[inside]), abs=1e-2)
    assert scores["base_color_psnr_scaled"] > scores["base_color_psnr"] + 0.5
    ratios = MINE[inside].mean(0) / TRUE[inside].mean(0)
    assert scores["base_color_ratio"] == pytest.approx(math.prod(ratios) ** (1 / 3), rel=1e-3)
    assert scores["base_color_ratio_worst"] == pytest.approx(0.5, rel=1e-3)  # blue: .45 to .9
    kinds = ("psnr", "psnr_scaled", "ratio", "ratio_worst")
    assert scores.keys() == {f"base_color_{kind}" for kind in kinds}


def test_a_tint_of_the_base_colour_is_all_that_the_scaled_score_leaves_out(tmp_path: Path) -> None:
    true = np.array([[0.3, 0.2, 0.1], [0.7, 0.7, 0.7], [0.2, 0.15, 0.6], [0.8, 0.25, 0.2]])
    scores = colors_scored(tmp_path, true * [0.5, 0.8, 1.25], true)
    assert scores["base_color_psnr"] < 25
    assert scores["base_color_psnr_scaled"] > 60
    assert scores["base_color_ratio"] == pytest.approx(0.5 ** (1 / 3), rel=1e-3)
    assert scores["base_color_ratio_worst"] == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize(
    ("mine", "true", "ratio", "worst"),
    [
        ((0.0, 0.2, 0.1), (0.03, 0.1, 0.1), (0.01 * 2) ** (1 / 3), 0.01),
        ((0.03, 0.1, 0.1), (0.0, 0.2, 0.1), (100 / 2) ** (1 / 3), 100.0),
        ((0.0001, 0.0002, 0.0), (0.0, 0.0001, 0.0002), 1.0, 1.0),
    ],
)
def test_a_black_channel_counts_as_the_darkest_grey_of_a_photo(
    tmp_path: Path, mine: tuple[float, ...], true: tuple[float, ...], ratio: float, worst: float
) -> None:
    scores = colors_scored(tmp_path, np.tile(mine, (4, 1)), np.tile(true, (4, 1)))
    assert scores["base_color_ratio"] == pytest.approx(ratio, rel=1e-3)
    assert scores["base_color_ratio_worst"] == pytest.approx(worst, rel=1e-3)


def test_roughness_is_green_and_metalness_blue_as_they_stand(tmp_path: Path) -> None:
    orm = np.array([[0.9, 0.4, 0.75], [0.0, 0.0, 0.0], [0.1, 0.5, 0.125], [0.6, 0.8, 0.5]])
    write_png(tmp_path / "orm.png", as_map(orm), srgb=False, bits=16)
    scores = MaterialScores()
    truth_of_orm = Truth(orm=tmp_path / "orm.png")
    scores.add(seen(truth_of_orm, roughness=[0.5, 0.9, 0.2, 0.75], metallic=[1.0, 0.9, 0.0, 0.5]))
    assert scores.result() == pytest.approx(
        {"roughness_mae": (0.1 + 0.3 + 0.05) / 3, "metallic_mae": (0.25 + 0.125) / 3}, abs=1e-4
    )
    scores.add(seen(truth_of_orm, roughness=[0.4, 0.9, 0.5, 0.8], metallic=[0.75, 0.9, 0.125, 0.5]))
    assert scores.result() == pytest.approx({"roughness_mae": 0.45 / 6, "metallic_mae": 0.375 / 6}, abs=1e-4)


@pytest.mark.parametrize(
    ("length", "degrees"), [(0.51, (90 + 45 + 180) / 3), (0.5, (90 + 180) / 2), (0.1, 135.0)]
)
def test_normals_are_compared_where_the_truth_has_one(tmp_path: Path, length: float, degrees: float) -> None:
    """One of length .5 or less is mixed of a surface and what is beside it."""
    diagonal = length * np.sqrt([0.0, 0.5, 0.5]) if length != 0.5 else np.array([0.0, 0.3, 0.4])
    true = np.array([[0.0, 0.6, 0.0], [0.0, 0.0, 0.0], diagonal, [0.0, -1.0, 0.0]])
    mine = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    write_exr(tmp_path / "normal.exr", np.dstack([as_map(true), np.ones((HEIGHT, WIDTH, 1), np.float32)]))
    scores = MaterialScores()
    scores.add(seen(Truth(normal=tmp_path / "normal.exr"), normal=mine))
    assert scores.result() == pytest.approx({"normal_degrees": degrees}, abs=1e-3)


def test_a_map_of_one_channel_is_refused(tmp_path: Path) -> None:
    write_exr(tmp_path / "normal.exr", np.ones((HEIGHT, WIDTH, 1), np.float32))
    with pytest.raises(InputError, match=r"normal\.exr has 1 channel"):
        MaterialScores().add(seen(Truth(normal=tmp_path / "normal.exr"), normal=np.ones((4, 3))))


def test_what_has_no_truth_has_no_scores() -> None:
    scores = MaterialScores()
    scores.add(seen(Truth()))
    assert scores.result() == {}


def test_a_map_of_another_size_is_refused_and_nothing_of_its_photo_counts(tmp_path: Path) -> None:
    write_png(tmp_path / "color.png", as_map(TRUE), bits=16)
    write_png(tmp_path / "orm.png", np.full((2 * HEIGHT, 2 * WIDTH, 3), 0.5), srgb=False)
    scores = MaterialScores()
    with pytest.raises(InputError, match=r"orm\.png has 6 x 4 pixels, but its photo 3 x 2"):
        scores.add(seen(Truth(base_color=tmp_path / "color.png", orm=tmp_path / "orm.png"), color=MINE))
    assert scores.result() == {}


@pytest.mark.parametrize("faces", ["", "f 1 2 9", "f a b c"])
def test_a_mesh_that_is_none_costs_no_other_score(tmp_path: Path, faces: str) -> None:
    decomposition = known_decomposition()
    (tmp_path / "mesh.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}")
    with pytest.raises(InputError, match="mesh"):
        surface_scores(decomposition, tmp_path / "mesh.obj")
    write_png(tmp_path / "color.png", as_map(TRUE), bits=16)
    materials = MaterialScores()
    materials.add(seen(Truth(base_color=tmp_path / "color.png"), color=MINE))
    scene = Scene(tmp_path, "transforms", (), (), (), decomposition.similarity)
    with pytest.warns(LightprobeWarning, match="Not all of the object is scored"):
        assert asset_scores(decomposition, scene, materials, CPU) == materials.result()


@pytest.mark.slow
def test_the_distance_of_surfaces_is_in_radii_of_the_true_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(truth, "_VIEWS", 12)
    vertices, faces = sphere(2)
    asset = known_decomposition().asset
    mesh = dataclasses.replace(
        asset.mesh, vertices=torch.from_numpy(0.8 * vertices), faces=torch.from_numpy(faces)
    )
    similarity = Similarity(np.array([1.0, -2.0, 3.0]), 4.0)
    mine = Decomposition(dataclasses.replace(asset, mesh=mesh), {}, similarity)
    lines = ["v {} {} {}".format(*(4 * v + similarity.center)) for v in vertices]
    lines += ["f {} {} {}".format(*(face + 1)) for face in faces]
    (tmp_path / "mesh.obj").write_text("\n".join(lines))
    assert surface_scores(mine, tmp_path / "mesh.obj") == pytest.approx({"chamfer": 0.2}, abs=0.01)


Relit = Callable[[list[np.ndarray], list[np.ndarray]], dict[str, float]]


SIDE = 12  # pixels of relit pictures


@pytest.fixture
def relit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Relit:
    """Score pictures (12, 12, 3) that a renderer is said to make, against linear truth (12, 12, 4)."""
    write_exr(tmp_path / "sky.exr", np.full((16, 32, 3), 0.5, np.float32))

    def scored(images: list[np.ndarray], true: list[np.ndarray]) -> dict[str, float]:
        left = [torch.tensor(image, dtype=torch.float32) for image in images]

        class Pictures:
            def __init__(self, decomposition: Decomposition, device: torch.device, config: RenderConfig):
                assert config is FAST_PICTURES

            def picture(self, environment: Environment, camera: Camera) -> tuple[Tensor, Tensor]:
                assert float(environment.texels.mean()) == pytest.approx(0.5)
                return left.pop(0), torch.ones(SIDE, SIDE)

        monkeypatch.setattr(truth, "Relighter", Pictures)
        lonely = (Truth(environment=tmp_path / "sky.exr"), Truth(linear=tmp_path / "0.exr"), Truth())
        truths = list(lonely)
        for k, image in enumerate(true):
            write_exr(tmp_path / f"{k}.exr", image.astype(np.float32))
            truths.insert(2 * k, Truth(environment=tmp_path / "sky.exr", linear=tmp_path / f"{k}.exr"))
        camera = camera_at((3.0, 1, 1), size=SIDE)
        photos = tuple(Photo(f"p{k}", camera, tmp_path / "p.png", truth=t) for k, t in enumerate(truths))
        decomposition = known_decomposition()
        return relight_scores(
            decomposition, Scene(tmp_path, "transforms", (), (), photos, decomposition.similarity), CPU
        )

    return scored


def even(*color: float) -> np.ndarray:
    return np.tile(np.array(color), (SIDE, SIDE, 1))


def test_a_render_without_coverage_or_of_another_size_is_one_sentence(relit: Relit) -> None:
    for true, told in (
        (even(0.2, 0.4, 0.1), "fourth channel"),
        (even(0.2, 0.4, 0.1, 1)[:6], "has 12 x 6 pixels"),
    ):
        with pytest.raises(InputError, match=told):
            relit([even(0.2, 0.4, 0.1)], [true])


def test_a_render_that_shows_nothing_costs_no_other_score(relit: Relit) -> None:
    one = [even(0.2, 0.4, 0.1)], [even(0.2, 0.5, 0.1, 1.0)]
    with pytest.warns(LightprobeWarning, match=r"1\.exr shows nothing of the object"):
        assert relit(one[0] * 2, [*one[1], even(0.2, 0.5, 0.1, 0.0)]) == relit(*one)
    with pytest.warns(LightprobeWarning):
        assert relit(one[0], [even(0.2, 0.5, 0.1, 0.0)]) == {}


def test_relit_pictures_are_scored_photo_by_photo_and_scaled_by_one_factor_for_all(relit: Relit) -> None:
    """Of pictures of one colour a and b, SSIM is (2 a b + c) / (a^2 + b^2 + c) in every channel, c = 10^-4."""
    true = [(0.2, 0.4, 0.1), (0.5, 0.1, 0.3)]
    mine = [tuple(np.array(color) * (0.5, 0.8, 1.5)) for color in true]
    scores = relit([even(*color) for color in mine], [even(*color, 1.0) for color in true])
    shown = zip(srgb(np.array(mine)), srgb(np.array(true)), strict=True)
    ssims = [(2 * a * b + 1e-4) / (a * a + b * b + 1e-4) for a, b in shown]
    psnrs = [decibels(np.array(a), np.array(b)) for a, b in zip(mine, true, strict=True)]
    assert scores["relight_psnr"] == pytest.approx(np.mean(psnrs), abs=1e-2)
    assert scores["relight_ssim"] == pytest.approx(np.mean(ssims), abs=1e-3)
    assert scores["relight_psnr_scaled"] > 60
    assert scores["relight_ssim_scaled"] == pytest.approx(1, abs=1e-3)
    assert relit([], []) == {}


def test_only_pixels_that_are_mostly_the_object_are_relit_and_one_highlight_sways_no_factor(
    relit: Relit,
) -> None:
    """Above half coverage. All but the highlight, which stays white, are best at twice their brightness."""
    image, true = even(0.1, 0.1, 0.1), even(0.2, 0.2, 0.2, 0.6)
    image[:2], true[:2] = 4.0, (0.3, 0.3, 0.3, 0.51)
    image[6:, 4:], true[6:, 4:] = 0.9, (0.0, 0.0, 0.0, 0.5)  # not the object's
    inside = true[..., 3] > 0.5
    scores = relit([image], [true])
    assert scores["relight_psnr"] == pytest.approx(decibels(image[inside], true[..., :3][inside]), abs=1e-2)
    assert scores["relight_psnr_scaled"] == pytest.approx(
        decibels(2 * image[inside], true[..., :3][inside]), abs=1e-2
    )
