import dataclasses

import numpy as np
import pytest
import scipy
import torch

from lightprobe.evaluation import relight
from lightprobe.imaging import read_hdr, read_ldr
from lightprobe.insertion import LayerFiles, PhotoView, Placement, insert, load_virtual_object
from lightprobe.light.environment import Environment
from tests.insertion.glbs import box, write
from tests.known_scene import SIMILARITY, known_decomposition, soft_sky
from tests.shapes import camera_at

SIZE = 160
GROUND = 0.3  # linear radiance of the ground in the photo


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A ball's photo on a plain ground, its light, and a box."""
    decomposition, light = known_decomposition(), Environment.from_panorama(soft_sky(2))
    camera = camera_at((7.0, 0.0, 4.0), size=SIZE, focal=120)
    pose = camera.camera_to_world.copy()
    pose[:3, 3] += SIMILARITY.center
    camera = dataclasses.replace(camera, camera_to_world=pose)
    image, cover = (t.numpy() for t in relight(decomposition, light, camera))
    color = (image + (1 - cover[..., None]) * GROUND).astype(np.float32)
    virtual = load_virtual_object(write(tmp_path_factory.mktemp("virtual") / "box.glb", box()))
    return decomposition, light, PhotoView(color, cover, camera), virtual


def foot(studio, x: float, y: float) -> tuple[float, float]:
    """The pixel of a point of the ground, normalised frame."""
    decomposition, _, photo, _ = studio
    camera = photo.camera.normalised(decomposition.similarity)
    return tuple(camera.project(np.array([[x, y, -1.0]]))[0, :2].tolist())


@pytest.fixture(scope="module")
def beside(studio):
    decomposition, light, photo, virtual = studio
    return insert(decomposition, light, photo, virtual, Placement(scale=0.4))


@pytest.mark.slow
def test_the_layers_make_the_picture(studio, beside, tmp_path):
    photo = studio[2]
    made = photo.color * beside.shadow * (1 - beside.mask[..., None]) + beside.beauty
    assert np.abs(made - beside.color).max() < 0.02  # grain of a clean photo
    beside.write(LayerFiles.of(tmp_path / "out.png"))
    names = ["out.beauty.exr", "out.mask.exr", "out.png", "out.shadow.exr"]
    assert sorted(p.name for p in tmp_path.iterdir()) == names
    rgba = read_hdr(tmp_path / "out.beauty.exr")
    assert np.array_equal(rgba[..., 3], beside.mask)
    before = [path.read_bytes() for path in sorted(tmp_path.iterdir())]
    with pytest.raises((AttributeError, ValueError)):  # while the last of them is written
        dataclasses.replace(beside, color=np.zeros(3), mask=np.zeros_like(beside.mask)).write(
            LayerFiles.of(tmp_path / "out.png")
        )
    assert [path.read_bytes() for path in sorted(tmp_path.iterdir())] == before
    shown = read_ldr(tmp_path / "out.png")[0]
    assert np.abs(shown - beside.color.clip(0, 1)).max() < 0.01


def test_the_virtual_object_is_drawn_and_throws_a_soft_shadow(studio, beside):
    photo = studio[2]
    solid = beside.mask > 0.99
    assert 60 < solid.sum() < 3000
    red, green, blue = beside.color[solid].mean(0)
    assert red > 2 * green > 2 * blue  # the box is red
    ground = (photo.mask == 0) & (beside.mask == 0)
    factor = beside.shadow[ground].mean(-1)
    assert factor.min() < 0.8
    assert np.median(factor) > 0.95
    steps = np.abs(np.diff(beside.shadow.mean(-1), axis=1))[ground[:, 1:] & ground[:, :-1]]
    assert steps.max() < 0.35
    assert (beside.shadow[:3] == pytest.approx(1, abs=0.03)) or photo.mask[:3].any()


def test_the_ground_at_the_virtual_object_s_edge_is_as_dark_as_beside_it(studio, beside):
    """Under the virtual object it is black, and a pixel that the virtual object covers in part shows what is beside."""
    photo = studio[2]
    open_ground = np.where((beside.mask < 0.01)[..., None], beside.shadow, np.inf)
    edge = (beside.mask > 0.05) & (beside.mask < 0.95) & (photo.mask == 0)
    assert edge.sum() > 20
    assert (beside.shadow >= scipy.ndimage.minimum_filter(open_ground, (5, 5, 1)))[edge].all()


def test_what_is_far_from_the_virtual_object_stays(studio, beside):
    photo = studio[2]
    far = (beside.mask == 0) & (np.abs(beside.shadow - 1).max(-1) < 1e-3)
    assert far.mean() > 0.2
    assert np.abs(beside.color - photo.color)[far].max() < 1e-3


@pytest.mark.long
def test_the_object_hides_what_is_behind_it_and_is_hidden_by_what_is_before(studio):
    decomposition, light, photo, virtual = studio
    behind, before = (
        insert(decomposition, light, photo, virtual, Placement(at=foot(studio, *spot), scale=0.5))
        for spot in ((-1.5, 1.0), (1.7, 0.0))
    )
    inside = photo.mask > 0.99
    assert behind.mask[inside].max() < 0.02
    assert before.mask[inside].max() > 0.99
    assert (behind.mask > 0.5).sum() > 0


@pytest.mark.long
def test_the_virtual_object_shades_the_object_that_stands_by(studio):
    decomposition, light, photo, virtual = studio
    sky = torch.zeros_like(light.texels) + 0.05
    sky[2, :, :, :] = 3.0  # bright from +y, where the virtual object stands
    placement = Placement(at=foot(studio, 0.3, 1.75), scale=0.8)
    near = insert(decomposition, Environment(sky), photo, virtual, placement)
    inside = (photo.mask > 0.99) & (near.mask == 0)
    left = near.shadow.mean(-1)[inside]
    assert left.min() < 0.85


@pytest.mark.long
def test_a_cut_out_photo_stays_one(studio):
    decomposition, light, photo, virtual = studio
    cut = dataclasses.replace(photo, opaque=False, color=photo.color * (photo.mask[..., None] > 0))
    found = insert(decomposition, light, cut, virtual, Placement(scale=0.4))
    assert found.alpha is not None
    assert found.alpha[found.mask > 0.99].min() > 0.98
    shadow = (photo.mask == 0) & (found.mask == 0) & (found.alpha > 0.1)
    assert shadow.any()
    assert found.color[shadow].max() < 0.02
    assert np.quantile(found.alpha, 0.2) < 0.05


@pytest.mark.long
def test_a_light_in_another_exposure_is_told(studio):
    decomposition, light, photo, virtual = studio
    found = insert(decomposition, light.scaled(6.0), photo, virtual, Placement(scale=0.4))
    assert any("exposure" in sentence for sentence in found.warnings)
