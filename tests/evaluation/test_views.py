import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.evaluation import relight, views
from lightprobe.evaluation.views import TestView, halves
from lightprobe.imaging import write_png
from lightprobe.light.environment import Environment
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Truth
from tests.known_scene import CPU, SIMILARITY, known_decomposition
from tests.shapes import camera_at


def test_halves_split_the_object_evenly_and_completely():
    alpha = np.zeros((20, 30), np.float32)
    alpha[3:15, 4:9] = 1
    alpha[10:12, 9:28] = 0.8
    inside = alpha > 0.5
    masks = halves(alpha)
    assert len(masks) == 4
    for first, second in (masks[:2], masks[2:]):
        assert np.array_equal(first | second, inside)
        assert not (first & second).any()
        assert 0.25 < first.sum() / inside.sum() < 0.75
    left, right, above, below = masks
    assert np.nonzero(left)[1].max() < np.nonzero(right)[1].min() + 1
    assert np.nonzero(above)[0].max() < np.nonzero(below)[0].min() + 1


def test_the_middle_pixel_belongs_to_the_right_and_lower_half_and_pixels_half_covered_to_neither() -> None:
    alpha = np.zeros((4, 5), np.float32)
    alpha[1, 1:4] = 1.0, 0.51, 0.6  # the middle column is 2, the middle row 1
    alpha[3, 2] = 0.9
    alpha[0, 0] = 0.5
    found = [[(int(i), int(j)) for i, j in np.argwhere(mask)] for mask in halves(alpha)]
    assert found == [[(1, 1)], [(1, 2), (1, 3), (3, 2)], [], [(1, 1), (1, 2), (1, 3), (3, 2)]]


SIZE = (16, 24)  # height and width of a photo of which the test knows every value
COLOR, ALPHA = (0.2, 0.5, 0.05), (1.0, 0.25, 0.0)  # linear; and from the left, a third of the width each


@pytest.fixture
def photo(tmp_path: Path) -> Photo:
    alpha = np.repeat(np.array(ALPHA, np.float32), 8)[None].repeat(SIZE[0], 0)
    write_png(tmp_path / "photo.png", np.tile(np.array(COLOR, np.float32), (*SIZE, 1)), alpha, bits=16)
    camera = camera_at((6.0, 2.0, 2.0), size=16, width=24, focal=22)
    moved = camera.camera_to_world.copy()
    moved[:3, 3] += SIMILARITY.center
    return Photo("photo", dataclasses.replace(camera, camera_to_world=moved), tmp_path / "photo.png")


def srgb(linear: float) -> float:
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


@pytest.mark.parametrize("at_once", [2**20, 30, 1])
def test_a_view_holds_the_photo_on_white_and_what_the_asset_shows_there(
    photo: Photo, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(views, "_SMALL", at_once)
    decomposition = known_decomposition()
    view = TestView.load(photo, decomposition, 16, CPU)
    assert view.mask.sum() == 16 * 8
    assert view.mask[:, :8].all()
    assert view.reference.shape == (*SIZE, 3)
    for third, alpha in enumerate(ALPHA):
        expected = [srgb(alpha * value + 1 - alpha) for value in COLOR]
        part = view.reference[:, 8 * third : 8 * third + 8].reshape(-1, 3)
        assert part.numpy() == pytest.approx(np.tile(expected, (len(part), 1)), abs=1e-3)
    light = torch.rand(6, 16, 16, 3, generator=torch.Generator().manual_seed(4))
    image, brighter = view.shown([light, 3 * light])
    rendered, cover = relight(decomposition, Environment(light), photo.camera)
    assert float(cover[8, 12]) == 1  # the asset is in the middle
    assert image[8, 12].tolist() == pytest.approx([srgb(float(value)) for value in rendered[8, 12]], abs=1e-4)
    assert brighter[8, 12].tolist() == pytest.approx(
        [srgb(min(3 * float(v), 1)) for v in rendered[8, 12]], abs=1e-4
    )
    assert image[0, 0].tolist() == pytest.approx([1, 1, 1])
    size = {2**20: (16, 24), 30: (4, 7), 1: (1, 1)}[at_once]
    assert (view.gbuffer.height, view.gbuffer.width) == size


def test_scores_are_of_the_photo_s_own_pixels(photo: Photo) -> None:
    view = TestView.load(photo, known_decomposition(), 16, CPU)
    image = view.reference.clone()
    image[:, :8, 1] -= 0.1  # green of all of the object
    scores = view.score(image)
    assert scores.psnr_masked == pytest.approx(-10 * np.log10(0.01 / 3), abs=1e-3)
    assert scores.psnr == pytest.approx(-10 * np.log10(0.01 / 9), abs=1e-3)
    some = torch.zeros(SIZE, dtype=torch.bool)
    some[:, 6:10] = True
    assert view.psnr(image, some) == pytest.approx(-10 * np.log10(0.01 / 6), abs=1e-3)
    assert view.psnr(image, ~view.mask) == 100


FILE = Path("truth.png")


@pytest.mark.parametrize(
    ("size", "truth", "reduced"),
    [
        ((20, 10), Truth(), (20, 10)),
        ((40, 20), Truth(), (20, 10)),
        ((60, 30), Truth(environment=FILE, linear=FILE), (20, 10)),
        ((2000, 1), Truth(), (632, 1)),
        ((1, 2000), Truth(), (1, 632)),
        ((40, 20), Truth(base_color=FILE), (40, 20)),
        ((40, 20), Truth(orm=FILE), (40, 20)),
        ((40, 20), Truth(normal=FILE), (40, 20)),
    ],
)
def test_a_large_photo_s_material_is_looked_at_in_full_only_where_there_is_truth(
    size: tuple[int, int], truth: Truth, reduced: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(views, "_SMALL", 200)
    camera = Camera(np.eye(4), 30.0, 30.0, size[0] / 2, size[1] / 2, *size)
    found = views._material_camera(Photo("a", camera, FILE, truth=truth), camera)
    assert (found.width, found.height) == reduced
    assert found.fx == pytest.approx(30 * reduced[0] / size[0])


def test_a_photo_that_memory_has_no_room_for_is_refused_before_it_is_read(
    photo: Photo, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Path, tuple[int, int]]] = []

    def refuse(path: Path, size: tuple[int, int], pixel_bytes: float) -> None:
        asked.append((path, size))
        raise InputError("too large")

    monkeypatch.setattr(views, "check_room", refuse)
    with pytest.raises(InputError, match="too large"):
        TestView.load(dataclasses.replace(photo, image_path=FILE), known_decomposition(), 16, CPU)
    assert asked == [(FILE, (24, 16))]
