"""Scene files with random parts replaced: read, or refused in one sentence, and nothing else."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lightprobe.core.errors import InputError
from lightprobe.scene import read_camera
from lightprobe.scene.frame import Problems
from lightprobe.scene.loading import read_folder
from tests.fuzz.edits import NUMBERS, TEXTS, VALUES, replaced
from tests.scene.worlds import names, views, write_colmap, write_nerd, write_nerfstudio

COUNT = 3
SCOPED = [HealthCheck.function_scoped_fixture]
MANY = settings(max_examples=60, deadline=None, suppress_health_check=SCOPED, derandomize=True)


def place(value, data):
    """Walk down a JSON value and return the path to where the walk ends: large parts are met no oftener than
    others.
    """
    path = ()
    while isinstance(value, dict | list) and value:
        keys = sorted(value) if isinstance(value, dict) else range(len(value))
        key = data.draw(st.sampled_from([None, *keys]))
        if key is None:
            break
        path, value = (*path, key), value[key]
    return path


def read_or_refused(root):
    """Read the folder, once stopping at the first problem and once collecting all."""
    collected = Problems(collect=True)
    for problems in (Problems(), collected):
        try:
            read_folder(root, problems)
        except InputError as error:
            one_sentence(str(error))
    for message in collected.messages:
        one_sentence(message)


def one_sentence(message):
    assert message.isprintable()
    assert message.endswith(".")
    assert len(message) < 1500


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A folder for each layout."""
    root = tmp_path_factory.mktemp("scenes")
    return {
        "nerd": write_nerd(root / "nerd", views(COUNT)),
        "transforms": write_nerfstudio(root / "transforms", views(COUNT)),
        "text": write_colmap(root / "text", views(COUNT), binary=False),
        "binary": write_colmap(root / "binary", views(COUNT), binary=True),
    }


@pytest.fixture(scope="module")
def frames(scenes):
    return json.loads((scenes["transforms"] / "transforms.json").read_text())


@MANY
@given(data=st.data())
def test_transforms(scenes, frames, data):
    value = {**frames, "train_filenames": ["images/view_00.jpg", "images/view_01.jpg"], "test_filenames": []}
    for _ in range(data.draw(st.integers(1, 2))):
        value = replaced(value, place(value, data), data.draw(VALUES))
    (scenes["transforms"] / "transforms.json").write_text(json.dumps(value))
    read_or_refused(scenes["transforms"])


@MANY
@given(data=st.data())
def test_camera_files(scenes, frames, data, tmp_path):
    camera = {"camera_to_world": frames["frames"][0]["transform_matrix"], "fx": 9, "fy": 9, "cx": 4, "cy": 4}
    camera |= {"width": 8, "height": 8}
    record = {"root": "/", "photos": {"train": {"a": {"image": "a.png", "camera": camera}}, "test": {}}}
    value = data.draw(st.sampled_from([camera, record, frames]))
    for _ in range(data.draw(st.integers(1, 2))):
        value = replaced(value, place(value, data), data.draw(VALUES))
    (tmp_path / "camera.json").write_text(json.dumps(value))
    try:
        read_camera(tmp_path / "camera.json", scenes["transforms"] / "images/view_01.jpg")
    except InputError as error:
        one_sentence(str(error))


@pytest.mark.slow
@MANY
@given(data=st.data())
def test_colmap_text(scenes, data):
    spoil(scenes["text"] / "sparse/0", "txt", data, lambda content: tokens(content, data))
    read_or_refused(scenes["text"])


@pytest.mark.slow
@MANY
@given(data=st.data())
def test_colmap_binary(scenes, data):
    spoil(scenes["binary"] / "sparse/0", "bin", data, lambda content: some_bytes(content, data))
    read_or_refused(scenes["binary"])


@MANY
@given(data=st.data())
def test_poses(scenes, data):
    path = scenes["nerd"] / "poses_bounds.npy"
    np.save(path, np.stack([np.arange(17.0)] * COUNT))
    path.write_bytes(some_bytes(path.read_bytes(), data))
    read_or_refused(scenes["nerd"])


def spoil(model, suffix, data, change):
    """Write the model anew, with one of its files changed; the sound files are kept beside."""
    for part in ("cameras", "images"):
        path: Path = model / f"{part}.{suffix}"
        sound = model / f"{part}.sound"
        if not sound.exists():
            path.rename(sound)
        path.write_bytes(sound.read_bytes())
    path = model / f"{data.draw(st.sampled_from(['cameras', 'images']))}.{suffix}"
    path.write_bytes(change(path.read_bytes()))


def tokens(content, data):
    """Replace words of a text by others."""
    words = content.decode().split(" ")
    for _ in range(data.draw(st.integers(1, 3))):
        new = data.draw(NUMBERS.map(str) | TEXTS | st.sampled_from(names(COUNT)))
        words[data.draw(st.integers(0, len(words) - 1))] = new
    return " ".join(words).encode(errors="surrogatepass")


def some_bytes(content, data):
    """Replace bytes, and cut or lengthen the whole."""
    spoilt = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(spoilt) - 1))
        new = data.draw(
            st.binary(min_size=1, max_size=8) | st.sampled_from([b"\xff" * 8, bytes(8), b"PK\x03\x04"])
        )
        spoilt[start : start + len(new)] = new
    return bytes(spoilt[: data.draw(st.integers(0, len(spoilt)) | st.just(len(spoilt)))])
