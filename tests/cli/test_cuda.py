"""The whole program on a GPU: what learns there must be usable there, and agree with the CPU."""

import numpy as np
import pytest
import torch

from lightprobe.cli.main import main
from lightprobe.imaging import read_hdr
from tests.toy_scene import TINY, TINY_DISTILL, write_toy_scene


@pytest.mark.cuda
@pytest.mark.filterwarnings("error:Steps cannot be recorded", "error:The CUDA Graph is empty")
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_train_predict_evaluate_and_export_on_a_gpu(tmp_path):
    scene, run = write_toy_scene(tmp_path / "scene"), tmp_path / "run"
    options = [*TINY, *TINY_DISTILL]
    options[options.index("--device") + 1] = "cuda"
    image = scene / "test" / "test_00.png"
    steps = [
        ["train", scene, "-o", run, *options],
        ["eval", run, "--device", "cuda"],
        [
            "relight",
            run,
            "--env",
            run / "env" / "train_00.exr",
            "-o",
            tmp_path / "r",
            "--frames",
            1,
            "--device",
            "cuda",
        ],
        ["export", run, "-o", tmp_path / "files", "--device", "cuda"],
        ["predict", run, image, "-o", tmp_path / "gpu.exr", "--device", "cuda"],
        ["predict", run, image, "-o", tmp_path / "cpu.exr", "--device", "cpu"],
    ]
    for step in steps:
        assert main([str(word) for word in step]) == 0
    gpu, cpu = read_hdr(tmp_path / "gpu.exr"), read_hdr(tmp_path / "cpu.exr")
    assert np.linalg.norm(gpu - cpu) <= 1e-3 * np.linalg.norm(cpu)
