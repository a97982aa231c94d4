"""Runs that differ in one bit of a result are told apart, and those that differ in when they ran are not."""

import json

import numpy as np
import pytest
import torch

import compare_runs
from lightprobe.core.checkpoint import save_tensors
from lightprobe.imaging import write_exr


def write_run(folder, *, radiance=1.0, weight=1.0, psnr=30.5, seconds=1.0, picture=b"picture"):
    for name in ("mesh", "env", "model"):
        (folder / name).mkdir(parents=True)
    save_tensors(folder / "model" / "network.safetensors", {"weight": torch.tensor([0.0, weight])})
    write_exr(folder / "env" / "photo.exr", np.full((2, 4, 3), radiance, np.float32))
    (folder / "mesh" / "normal.png").write_bytes(picture)
    scores = {"mean": {"psnr": psnr, "seconds": seconds}, "photos": [{"ssim": 0.5}]}
    (folder / "metrics.json").write_text(json.dumps(scores))
    (folder / "log.txt").write_text(f"{seconds}")
    (folder / "timings.json").write_text(f"{seconds}")
    return folder


def test_what_was_timed_may_differ(tmp_path, capsys):
    runs = [str(write_run(tmp_path / name, seconds=float(len(name)))) for name in ("one", "another")]
    assert compare_runs.main(runs) == 0
    assert capsys.readouterr().out == "The same: 4 files.\n"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"radiance": 1.5}, "env/photo.exr: map differs by up to 0.5"),
        (
            {"weight": float(np.nextafter(np.float32(1), np.float32(2)))},
            "model/network.safetensors: weight differs",
        ),
        ({"weight": -1.0}, "model/network.safetensors: weight differs by up to 2"),
        ({"psnr": 30.25}, "metrics.json: mean.psnr 30.5 and 30.25"),
        ({"picture": b"Picture"}, "mesh/normal.png: other bytes"),
    ],
)
def test_one_bit_is_named(tmp_path, capsys, change, line):
    one, other = write_run(tmp_path / "one"), write_run(tmp_path / "other", **change)
    assert compare_runs.main([str(one), str(other)]) == 1
    found = capsys.readouterr().out.splitlines()
    assert len(found) == 1
    assert found[0].startswith(line)


def test_a_missing_file_is_named(tmp_path, capsys):
    one, other = write_run(tmp_path / "one"), write_run(tmp_path / "other")
    (other / "env" / "photo.exr").unlink()
    assert compare_runs.main([str(one), str(other)]) == 1
    assert "env/photo.exr: only in" in capsys.readouterr().out


def test_nothing_to_compare_and_a_damaged_file_are_sentences(tmp_path, capsys):
    one, other = write_run(tmp_path / "one"), write_run(tmp_path / "other")
    assert compare_runs.main([str(one), str(tmp_path / "nothing")]) == 2
    assert "nothing holds no results" in capsys.readouterr().err
    (other / "env" / "photo.exr").write_bytes(b"")
    assert compare_runs.main([str(one), str(other)]) == 2
    assert "cannot be compared" in capsys.readouterr().err
