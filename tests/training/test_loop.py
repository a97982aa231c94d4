"""The loop on a parabola: its schedule, its checkpoints, and who is refused."""

import math
import os
from dataclasses import dataclass, field, replace

import pytest
import torch
from torch import Tensor

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.errors import ConfigError, ConvergenceError, InputError
from lightprobe.training import ParameterGroup, Progress, Stage, Training
from lightprobe.training.descent import cosine, exponential
from lightprobe.training.loop import LossReader, visited

FIRST = Stage("first", 0, 7, exponential(7))
SECOND = Stage("second", 7, 5, cosine(5), largest_gradient=0.5)


@dataclass
class Parabola:
    """|x - 3|^2, with a count of steps as a buffer."""

    x: Tensor = field(default_factory=lambda: torch.zeros(2, requires_grad=True))
    count: Tensor = field(default_factory=lambda: torch.zeros(()))
    refreshed: list[int] = field(default_factory=list)
    recordable = False
    broken_at: int = -1

    def groups(self):
        return [ParameterGroup({"x": self.x}, 0.3)]

    def buffers(self):
        return {"count": self.count}

    def load_buffers(self, tensors):
        self.count.copy_(tensors["count"])

    def refresh(self, iteration, fraction):
        self.refreshed.append(iteration)

    def given(self, iteration):
        return (torch.tensor(3.0),)

    def loss(self, iteration, fraction, *given):
        assert fraction < 1
        return (self.x - given[0]).square().sum() * (math.nan if iteration == self.broken_at else 1.0)

    def photos(self, iteration):
        return f"'photo{iteration}'"

    def project(self):
        self.count += 1


def training(progress: Progress | None = None, **changes) -> Training:
    whole = Training("Phase I", {"size": 3, "pair": (1, 2)}, 5, (FIRST, SECOND), 3, progress or Progress())
    return replace(whole, **changes)


def learn(progress: Progress | None = None) -> Parabola:
    """Do what a phase does: go on from the newest checkpoint, or begin."""
    run = training(progress)
    resumed, first, second = run.latest(), Parabola(), Parabola()
    if resumed is None or resumed.stage == FIRST.name:
        run.run(first, FIRST, resumed)
        resumed, start = None, run.begin(SECOND, {"x": first.x, "count": first.count})
    else:
        start = resumed.start
    with torch.no_grad():
        second.x.copy_(start["x"])
        second.count.copy_(start["count"])
    run.run(second, SECOND, resumed, start)
    return second


def test_it_descends_and_tells_of_every_step():
    told = []
    task = Parabola()
    training(Progress(on_step=lambda *step: told.append(step))).run(task, FIRST)
    assert [step[:3] for step in told] == [("first", k + 1, 7) for k in range(7)]
    assert told[-1][3] < 0.5 * told[0][3]
    assert task.refreshed == [0, 3, 6]
    assert float(task.count) == 7


@pytest.mark.parametrize("killed_at", [2, 4, 7, 9, 11])
def test_a_killed_training_ends_with_the_same_bits(tmp_path, killed_at):
    class KilledError(Exception):
        pass

    def kill(stage, step, steps, loss):
        if training().stage(stage).first_step + step == killed_at:
            raise KilledError

    whole = learn()
    with pytest.raises(KilledError):
        learn(Progress(Checkpoints(tmp_path), kill))
    resumed = learn(Progress(Checkpoints(tmp_path)))
    assert torch.equal(whole.x, resumed.x)
    assert float(resumed.count) == float(whole.count) == 12


def test_a_resumed_training_removes_the_checkpoints_that_a_killed_one_no_longer_could(tmp_path):
    """The last of a training may be whole, and the process end before the one before the last two is gone."""
    learn(Progress(Checkpoints(tmp_path, keep=100)))
    kept = sorted(os.listdir(tmp_path))
    assert len(kept) > 2
    learn(Progress(Checkpoints(tmp_path)))
    assert sorted(os.listdir(tmp_path)) == kept[-2:]


def test_a_checkpoint_names_its_tensors_and_its_configuration(tmp_path):
    learn(Progress(Checkpoints(tmp_path)))
    step, tensors, state = Checkpoints(tmp_path).latest()
    moments = {f"{kind}.x" for kind in ("parameter", "adam_mean", "adam_square", "adam_updates", "start")}
    assert tensors.keys() == moments | {"buffer.count", "start.count"}
    place = {"phase": "Phase I", "stage": "second", "iteration": 5}
    assert (step, state) == (12, {**place, "config": {"size": 3, "pair": [1, 2]}, "seed": 5})


@pytest.mark.parametrize("change", [{"config": {"size": 4}}, {"seed": 6}])
def test_another_configuration_is_refused(tmp_path, change):
    progress = Progress(Checkpoints(tmp_path))
    learn(progress)
    with pytest.raises(ConfigError, match="another Phase I configuration or seed"):
        training(progress, **change).latest()


@pytest.mark.parametrize(
    "change",
    [{"phase": "Phase II"}, {"stages": (FIRST,)}, {"stages": (FIRST, replace(SECOND, iterations=3))}],
)
def test_another_training_is_refused(tmp_path, change):
    progress = Progress(Checkpoints(tmp_path))
    learn(progress)
    with pytest.raises(InputError, match=r"step-000000012 does not fit"):
        training(progress, **change).latest()


def test_a_loss_that_is_not_a_number_names_its_photo_and_leaves_no_checkpoint(tmp_path):
    with pytest.raises(ConvergenceError, match=r"nan in first at step 4 on photo 'photo4'"):
        training(Progress(Checkpoints(tmp_path))).run(Parabola(broken_at=4), FIRST)
    assert Checkpoints(tmp_path).latest()[0] == 3


def test_schedules():
    falling, warm, waning = exponential(10), exponential(10, warm_up=4), cosine(10)
    assert falling(2.0, 0) == 2.0
    assert falling(2.0, 10) == pytest.approx(0.2)
    assert warm(2.0, 0) == pytest.approx(0.5)
    assert warm(2.0, 4) == falling(2.0, 4)
    assert (waning(2.0, 0), waning(2.0, 5)) == (2.0, pytest.approx(1.0))


def test_every_photo_is_visited_once_an_epoch_in_an_order_of_its_own():
    orders = [[visited(1, "order", 9, 9 * epoch + k) for k in range(9)] for epoch in range(3)]
    assert all(sorted(order) == list(range(9)) for order in orders)
    assert orders[0] != orders[1]
    assert orders == [[visited(1, "order", 9, 9 * epoch + k) for k in range(9)] for epoch in range(3)]


def test_on_a_cpu_every_loss_is_known_at_once():
    heard = []
    losses = LossReader(torch.device("cpu"))
    losses.add(torch.tensor(1.0), heard.append)
    assert heard == [1.0]
    losses.read()
    assert heard == [1.0]


def test_on_a_gpu_losses_come_in_bunches_in_their_order_and_none_is_lost():
    heard = []
    losses = LossReader(torch.device("cuda", 0))
    for step in range(60):
        losses.add(
            torch.tensor(float(step), requires_grad=True),
            lambda value, step=step: heard.append((step, value)),
        )
        assert len(heard) == 25 * ((step + 1) // 25)
    losses.read()
    assert heard == [(step, float(step)) for step in range(60)]
