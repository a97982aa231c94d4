"""The files of a scene, written of photos through a lens whose cameras and masks are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.files import checksum
from lightprobe.preparation import output
from lightprobe.preparation.labelled import Labelled, Masks
from lightprobe.preparation.masks import Cutting
from lightprobe.preparation.options import PrepareOptions
from lightprobe.preparation.output import write_scene
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.undistortion import pinhole_camera
from lightprobe.preparation.voxel_labelling import Labelling, View
from lightprobe.scene import load_alpha, load_scene
from lightprobe.scene.consistency import overlap
from lightprobe.scene.hull import Hull
from tests.preparation.ring import SIZE, ball_points, disc, photographed, ring_cameras

pytest.importorskip("cv2")
K = -0.3
LARGE = 3  # times as large as the small pictures are the photos


@pytest.fixture
def prepared(tmp_path):
    """All that `write_scene` needs of five photos of a ball."""
    cameras = ring_cameras(5)
    _, matches, solution = photographed(cameras, ball_points(60))
    solution = replace(solution, lens=solution.lens + np.array([0, 0, 0, K]))
    rng, photos, views = np.random.default_rng(0), [], {}
    for index, camera in enumerate(cameras):
        path, side = tmp_path / f"p{index}.jpg", LARGE * SIZE
        Image.fromarray(rng.integers(0, 255, (side, side, 3), np.uint8)).save(path)
        photos.append(SourcePhoto(path.stem, path, side, side, checksum(path), None, None, False))
        small = pinhole_camera(camera, K, path.stem)
        views[index] = View(small, np.zeros((SIZE, SIZE, 3), np.uint8), None, False)
    masks = {index: disc(view.camera) for index, view in views.items()}
    hull = Hull(np.ones((8, 8, 8), bool), np.zeros((8, 8, 8), np.float32), -np.full(3, 0.5), np.full(3, 0.5))
    kept = SimpleNamespace(
        **{"solution": solution, "apart": (), "share": {}, "agreement": {}, "to_json": dict},
        fit=SimpleNamespace(explained=1.0),
    )
    choice = SimpleNamespace(kept=kept, trap=None, why="", tried=(), moving=False)
    names = {index: photo.name for index, photo in enumerate(photos)}
    found = Masks(masks, dict.fromkeys(masks, 1.0), {index: f"{index}" for index in masks})
    cutting = Cutting(choice, Labelled(names, views, Labelling(hull, hull, {}, {})), found, hull)
    seen = [SimpleNamespace(color=view.color, sharpness=1.0) for view in views.values()]
    steps = []

    def write():
        return write_scene(
            tmp_path / "scene",
            photos,
            seen,
            matches,
            cutting,
            PrepareOptions(),
            "key",
            lambda *s: steps.append(s),
        )

    return tmp_path, write, steps


def test_a_scene_of_photos_through_a_lens_loads_with_lens_and_masks(prepared):
    folder, write, steps = prepared
    write()
    told = [(f"scene: {what}", done, 5) for what in ("photos", "masks") for done in range(1, 6)]
    assert steps == told
    scene = load_scene(folder / "scene")
    for photo in (*scene.train, *scene.test):
        assert photo.image_path.read_bytes() == (folder / photo.image_path.name).read_bytes()
        assert photo.camera.lens.radial[0] == K
        index = int(photo.name[1:])
        small = pinhole_camera(ring_cameras(5)[index], K, photo.name)
        assert photo.camera.fx == pytest.approx(LARGE * small.fx)
        assert overlap(load_alpha(photo, SIZE) >= 0.5, disc(small)) > 0.98


def test_what_ends_before_the_masks_are_there_is_no_scene_and_goes_on_without_copying_anew(
    prepared, monkeypatch
):
    folder, write, _ = prepared
    with monkeypatch.context() as patched:
        patched.setattr(output, "write_masks", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            write()
    assert sorted(path.name for path in (folder / "scene").iterdir()) == [".prepare", "images"]
    copied = {path: path.stat().st_ino for path in (folder / "scene" / "images").iterdir()}
    write()
    assert {path: path.stat().st_ino for path in (folder / "scene" / "images").iterdir()} == copied
    assert len(load_scene(folder / "scene").train) == 4
