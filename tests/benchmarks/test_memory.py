"""Peaks are those of the command alone, and the table has a cell for every photo."""

import sys

import numpy as np
import pytest

import measure_memory
from lightprobe.imaging import PhotoFile, read_ldr, read_mask
from lightprobe.scene import load_scene

HOLD = "import numpy; held = numpy.ones(2**24); print(1)"  # 128 MiB


@pytest.mark.slow
def test_a_peak_is_the_commands_own():
    held = np.ones(2**27)  # 1 GiB here is none of the command's
    less = measure_memory.peak([sys.executable, "-c", "import numpy"])
    more = measure_memory.peak([sys.executable, "-c", HOLD])
    assert more[0] - less[0] == pytest.approx(0.125, abs=0.02)
    assert less[0] < 0.5 < held.nbytes / 2**30
    failed = measure_memory.peak([sys.executable, "-c", "import sys; sys.exit('no')"])
    assert failed[1:] == (1, "no\n")


@pytest.mark.slow
def test_a_photo_and_a_scene_of_it_are_made(tmp_path):
    measure_memory.write_shot(0.09, "png", tmp_path)
    color, cover = read_ldr(tmp_path / "photo.png")[0], read_mask(tmp_path / "mask.png")
    assert color.shape[:2] == cover.shape == (300, 300)
    assert 0.05 < cover.mean() < 0.6
    scene = load_scene(tmp_path / "scene")
    photos = {photo.name: photo for photo in (*scene.train, *scene.test)}
    assert photos["a"].camera.width == photos["b"].camera.width == 300
    assert len(photos) == 9
    for kind in ("jpg", "webp", "tif", "exr"):
        file = tmp_path / f"photo.{kind}"
        measure_memory.write_photo(measure_memory.as_picture(color[:40, :60]), file)
        assert (PhotoFile(file).width, PhotoFile(file).height) == (60, 40)


def test_the_table_has_a_row_for_each_command(tmp_path, capsys, monkeypatch):
    (tmp_path / "run").mkdir()
    seen = []

    def make_shot(run, megapixels, kind, folder):
        assert (run / "..").resolve() == folder.resolve()  # a copy
        return measure_memory.Shot(*(folder / name for name in (f"a.{kind}", "c", "m", "l", "s")), run)

    def peak(command):
        seen.append(command)
        return float(len(seen)), int("predict" in command), "said"

    monkeypatch.setattr(measure_memory, "make_shot", make_shot)
    monkeypatch.setattr(measure_memory, "peak", peak)
    options = [
        "--megapixels",
        "1",
        "4",
        "--kinds",
        "jpg",
        "--commands",
        "read",
        "predict",
        "--max-memory",
        "1GB",
    ]
    measure_memory.main([str(tmp_path / "run"), *options])
    lines = capsys.readouterr().out.strip().splitlines()
    assert lines[-4:] == [
        "| command | 1 MP jpg | 4 MP jpg |",
        "| --- | ---: | ---: |",
        "| read | 1.00 | 3.00 |",
        "| predict | (2.00) | (4.00) |",
    ]
    assert ["--max-memory" in command for command in seen] == [False, True, False, True]
