import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.scene import load_scene
from speed.paper import BEGIN, END, PASSES, Gpu, Work, full_size, hours, measure, replaced, rows, small, works
from tests.toy_scene import write_toy_scene


def test_hours_are_those_of_all_steps_and_lessons():
    steps = {"pass1": 0.9, "pass2": 0.45, "Phase II": 0.12}
    assert hours(steps, 36.0, full_size(), photos=100) == pytest.approx(10 + 5 + 1 + 1)


def test_a_projection_takes_a_share_of_the_limits():
    gpu = Gpu("some", 1e12, 1e11, share=0.5, launch=1e-5)
    assert Work(1e9, 1e8, 100).seconds(gpu) == pytest.approx((1e-3 + 1e-3) / 0.5 + 1e-3)
    assert works(full_size())["Phase II"].flops > 1024 * 6 * 128 * 128


def test_only_the_marked_lines_are_replaced():
    assert replaced(f"a\n{BEGIN}\nold\n{END}\nb\n", "new\n") == f"a\n{BEGIN}\n\nnew\n\n{END}\nb\n"
    with pytest.raises(InputError, match="no lines between"):
        replaced("a page", "new")


@pytest.mark.long
def test_every_part_of_the_preset_is_measured(tmp_path):
    scene = load_scene(write_toy_scene(tmp_path, train=4, test=1))
    costs = measure(scene, small(), 3, 6, torch.device("cpu"))
    assert all(costs.steps[name] > 0 for name in PASSES)
    assert costs.photos == 3
    text = "\n".join(rows(costs, small(), "Beside other jobs."))
    assert "Beside other jobs." in text
    assert "| first pass |" in text
    with pytest.raises(InputError, match="--steps of at least"):
        measure(scene, small(), 4, 3, torch.device("cpu"))
