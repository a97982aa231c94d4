"""Files of environments: which of a folder are taken, how a light is laid out in them, and what is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError, ConvergenceError, InputError
from lightprobe.imaging import read_hdr
from lightprobe.light import cubemap
from lightprobe.light.files import (
    FORMAT,
    check_map_name,
    environment_files,
    light_file,
    panorama,
    plane,
    write_map,
    write_plane,
)

MAGIC = {".exr": b"\x76\x2f\x31\x01", ".hdr": b"#?RADIANCE"}


def test_maps_of_a_folder_come_by_name_in_either_case_of_letters(tmp_path: Path) -> None:
    for name in ("c.exr", "B.HDR", "a.hdr", "b.EXR", "d.png", "exr", "e.exr.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in environment_files(tmp_path)] == ["B.HDR", "a.hdr", "b.EXR", "c.exr"]


def test_what_is_no_folder_of_maps_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape(f"{tmp_path} has no .exr or .hdr environment map.")):
        environment_files(tmp_path)
    (tmp_path / "file.exr").touch()
    with pytest.raises(InputError, match=r"file\.exr is not a folder of environment maps\.$"):
        environment_files(tmp_path / "file.exr")


def test_a_light_lies_in_its_file_with_plus_x_in_the_middle_plus_y_left_of_it_and_plus_z_on_top() -> None:
    image = panorama(cubemap.directions(8).requires_grad_())
    assert image.shape == (16, 32, 3)
    assert image.dtype == np.float32
    sides = {(8, 16): (1, 0, 0), (8, 8): (0, 1, 0), (8, 24): (0, -1, 0), (8, 0): (-1, 0, 0)}
    for (row, column), axis in (sides | {(0, 5): (0, 0, 1), (15, 20): (0, 0, -1)}).items():
        assert image[row, column] == pytest.approx(axis, abs=0.15)


def test_one_number_for_each_direction_is_a_plane_of_the_same_layout(tmp_path: Path) -> None:
    towards = cubemap.directions(4)
    assert np.array_equal(plane(towards[..., 1]), panorama(towards)[..., 1])
    write_plane(tmp_path / "seen.exr", towards[..., 1])
    assert np.array_equal(read_hdr(tmp_path / "seen.exr"), plane(towards[..., 1])[..., None])


@pytest.mark.parametrize("name", ["light.exr", "light.hdr", "light.EXR", "light.Hdr"])
def test_the_suffix_chooses_the_format(tmp_path: Path, name: str) -> None:
    image = np.array([[[1.0, 0.5, 0.25], [2.0, 4.0, 1.0]]], np.float32)
    write_map(tmp_path / name, image)
    assert (tmp_path / name).read_bytes().startswith(MAGIC[name[-4:].lower()])
    assert read_hdr(tmp_path / name) == pytest.approx(image, rel=0.01)


def test_what_was_told_of_an_older_map_goes_and_of_the_other_format_stays(tmp_path: Path) -> None:
    image = np.ones((1, 2, 3), np.float32)
    for name in ("light.exr", "light.hdr"):
        write_map(tmp_path / name, image)
    facts = light_file(tmp_path / "light.exr")
    told = {"format": FORMAT, "map": {"file": "light.exr", "copies": ["light.hdr"], "sun": "separate"}}
    facts.write_text(json.dumps(told))
    write_map(tmp_path / "light.hdr", image)
    assert json.loads(facts.read_text()) == {**told, "map": {**told["map"], "copies": []}}
    write_map(tmp_path / "light.hdr", image)
    assert facts.is_file()
    write_map(tmp_path / "light.exr", image)
    assert not facts.exists()


@pytest.mark.parametrize("words", ['{"author": "me"}', '{"map": {"file": "light.exr"}}', "no JSON"])
def test_somebody_else_s_file_stays(tmp_path: Path, words: str) -> None:
    light_file(tmp_path / "light.exr").write_text(words)
    write_map(tmp_path / "light.exr", np.ones((1, 2, 3), np.float32))
    assert light_file(tmp_path / "light.exr").read_text() == words


@pytest.mark.parametrize("name", ["light.png", "light", "exr", "light.exr.gz"])
def test_no_other_suffix_is_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=f"Cannot write an environment as '{name}': name it .exr or .hdr"):
        check_map_name(tmp_path / name)
    with pytest.raises(ConfigError):
        write_map(tmp_path / name, np.ones((1, 2, 3), np.float32))
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_not_written(tmp_path: Path, value: float) -> None:
    image = np.ones((1, 2, 3), np.float32)
    image[0, 1, 2] = value
    with pytest.raises(ConvergenceError, match=r"The light for .*light\.exr holds NaN or infinity"):
        write_map(tmp_path / "light.exr", image)
    assert not (tmp_path / "light.exr").exists()
