"""The tables of SPEED.md from made-up numbers, the profile against the loss it takes apart, and a small real
page.
"""

import pytest
import torch

from lightprobe.core.run import RunFolder
from lightprobe.core.timings import PhaseTiming, write_timing
from lightprobe.kernels.numba import stacking
from speed import cases, phase1, training
from speed.ball import ball, camera
from speed.clock import Parts
from speed.growth import exponent, growth_rows
from speed.kernels import LOBE, Kernel, Timing, all_kernels, kernel_rows, stacking_kernels
from speed.limits import Limits, measure_limits
from speed.page import Plan, page
from speed.target import PARTS, SIDE, Target, target_rows

LIMITS = Limits(copy=10e9, registers=100e9, matrix=80e9)


def test_the_exponent_is_the_power_of_a_power_law():
    sizes = [1.0, 2.0, 5.0]
    assert exponent(sizes, [3 * s**1.5 for s in sizes]) == pytest.approx(1.5)
    assert exponent(sizes, [7.0, 7.0, 7.0]) == pytest.approx(0, abs=1e-12)


def test_growth_is_told_by_size():
    rows = growth_rows(
        "pixels", {1000.0: {"solve": 0.001, "render": 0.002}, 10000.0: {"solve": 0.01, "render": 0.002}}
    )
    assert rows == [
        "| pixels | 1,000 | 10,000 | exponent |",
        "| --- | ---: | ---: | ---: |",
        "| solve | 1.0 | 10.0 | 1.00 |",
        "| render | 2.0 | 2.0 | 0.00 |",
    ]


def test_a_kernel_is_held_against_the_limit_it_meets():
    flops = Timing(Kernel("sums", "stacking", lambda body: None, 5e9), 0.1, 1.0)
    moved = Timing(Kernel("rows", "gather", lambda body: None, 1e9, flops=False), 0.2, 0.1)
    rows = kernel_rows([flops, moved], LIMITS)
    assert rows[2] == "| sums | 100.0 | 1000 | 10.0 | 5.000 GFLOP | 50.0 GFLOP/s | 50 % |"
    assert rows[3] == "| rows | 200.0 | 100 | 0.5 | 1.000 GB | 5.0 GB/s | 50 % |"


def test_stacking_claims_the_work_of_its_pairs():
    forward, backward, weight = (kernel.work for kernel in stacking_kernels(16))
    pairs = 16 * 6 * 64 * 64
    assert (forward, backward, weight) == (pairs * (LOBE + 8), pairs * (LOBE + 6), pairs * (LOBE + 2))


class Booked:
    """A number that counts what is done with it."""

    count = 0

    def __init__(self, value):
        self.value = value

    def _booked(self, result):
        Booked.count += 1
        return result if isinstance(result, bool) else Booked(result)

    def __add__(self, other):
        return self._booked(self.value + other.value)

    def __mul__(self, other):
        return self._booked(self.value * other.value)

    def __truediv__(self, other):
        return self._booked(self.value / other.value)

    def __gt__(self, other):  # what `max` asks
        return self._booked(self.value > other.value)


def test_a_pair_has_as_many_operations_as_its_formula(monkeypatch):
    monkeypatch.setattr(stacking, "components", stacking.components.py_func)
    monkeypatch.setattr(stacking, "TINY", Booked(0.0))
    monkeypatch.setattr(stacking, "ZERO", Booked(0.0))
    monkeypatch.setattr(Booked, "count", 0)
    stacking.lobe.py_func([Booked(0.1 * (i + 1)) for i in range(13)], Booked(0.5), Booked(0.6), Booked(0.7))
    assert Booked.count - 1 == LOBE  # the loop's s^2 is written twice and compiled once


def test_the_target_says_what_it_needs():
    assert "--run RUN" in target_rows(None)[0]
    seconds = dict.fromkeys(PARTS, 0.1)
    rows = target_rows(Target("probe-net", "a", 40_000, seconds, 1.25))
    assert rows[-1] == f"| probe-net on photo a | 40,000 | {' | '.join(['100'] * len(PARTS))} | 1.25 GiB |"
    assert f"{SIDE} x {SIDE}" in rows[0]


def test_the_timings_of_a_run_are_read(tmp_path):
    write_timing(tmp_path / "timings.json", "decompose", PhaseTiming(425.2, 2.31, True))
    write_timing(tmp_path / "timings.json", "distill", PhaseTiming(38.1, 1.1, True))
    assert training.run_rows(RunFolder(tmp_path))[-1] == f"| {tmp_path.name} | 425 | 38 | 2.31 GiB |"
    assert "--run RUN" in training.run_rows(None)[0]


def test_parts_are_medians_over_rounds():
    parts = Parts()
    for _ in range(3):
        with parts.part("a"):
            pass
    assert 0 <= parts.medians(1)["a"] < 1
    rows = training.part_rows("step", {"a": 0.003, "b": 0.001})
    assert rows[2:] == ["| a | 3.0 | 75 % |", "| b | 1.0 | 25 % |", "| sum | 4.0 | |"]


def test_cameras_look_at_the_ball_from_all_around():
    views = [camera(32, number, 12) for number in range(12)]
    for view in views:
        assert view.project([[0.0, 0, 0]])[0] == pytest.approx([16, 16, 3.2])
        assert torch.linalg.det(torch.from_numpy(view.camera_to_world[:3, :3])) == pytest.approx(1)
    assert abs(sum(view.position for view in views)).max() < 5


@pytest.mark.long
@pytest.mark.parametrize("make", [phase1.first_pass, phase1.second_pass])
def test_the_profile_takes_apart_the_loss_that_is_trained_with(make):
    config = training.small().decompose
    task, same = (make(ball(2, 128), 2, config, 3) for _ in range(2))
    for one in (task, same):
        one.refresh(0, 0.0)
    parts = Parts()
    assert torch.equal(phase1.image_loss_parts(task, 1, parts), same.loss(1, 1 / 3))
    assert len(parts.medians()) == 4


def test_the_cases_are_what_they_are_called():
    screen, faces = cases.bumpy_sphere()
    assert len(faces) == 81_796
    assert int(faces.max()) < len(screen)
    assert cases.probes()[4].shape[0] * len(cases.probes()[0]) == 25_165_824


@pytest.mark.long
def test_a_small_page():
    assert measure_limits(1).arithmetic > 1e8
    text = page(Plan(quick=True))
    for kernel in all_kernels(quick=True):
        assert f"| {kernel.name} |" in text
    for title in (
        "object pixels",
        "texels of the light",
        "triangles",
        "photos, ms",
        "first pass of Phase I",
        "sphere network of Phase II",
    ):
        assert f"| {title}" in text
    assert "nan" not in text
