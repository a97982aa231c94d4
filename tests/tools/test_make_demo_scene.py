"""The command itself, at the smallest size; it runs apart, as a wrong LLVM ends its process without an
exception.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"
PROBE = "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); import drjit as dr; print(dr.maximum(mi.Float([1, 2]), 1.5))"


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=300, check=False
    )


@pytest.mark.long
def test_equal_options_make_equal_scenes(tmp_path):
    if run("-c", PROBE).returncode != 0:
        pytest.skip("Mitsuba finds no LLVM library it can use")
    script = str(TOOLS / "make_demo_scene.py")
    options = ("--side", "32", "--samples", "16", "--train", "2", "--test", "1")
    for name in ("a", "b"):
        made = run(script, str(tmp_path / name), *options)
        assert made.returncode == 0, made.stderr
    first, second = (
        sorted(path for path in (tmp_path / name).rglob("*") if path.is_file()) for name in ("a", "b")
    )
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert len(json.loads((tmp_path / "a/transforms_train.json").read_text())["frames"]) == 2


@pytest.mark.slow
def test_a_folder_that_is_no_scene_is_left_alone(tmp_path):
    (tmp_path / "holiday.txt").write_text("mine")
    refused = run(str(TOOLS / "make_demo_scene.py"), str(tmp_path))
    assert refused.returncode == 2
    assert "is not a scene" in refused.stderr
    assert (tmp_path / "holiday.txt").read_text() == "mine"
