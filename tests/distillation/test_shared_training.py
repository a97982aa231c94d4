"""Phase II by several processes: the weights of one process, within rounding."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.config.distillation import DistillConfig, LossSpace, RadianceUnit
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.distillation.training import train
from lightprobe.training import Progress
from tests.lit_sphere import CPU, glossy_sphere, lessons
from tests.shared_training import in_processes

CONFIG = DistillConfig(  # pixels and photos of a step can be shared by neither two nor three
    steps=20,
    samples=257,
    width=32,
    depth=2,
    checkpoint_every=10,
    sphere_steps=8,
    sphere_batch=5,
    sphere_width=4,
)
ROUNDING = 1e-6  # of a weight; one step moves it by as much as 5e-4


@pytest.fixture(scope="module")
def photos():
    return lessons(glossy_sphere())


def weights(model):
    """Return the weights of both networks by name."""
    return {
        f"{part}.{k}": v
        for part in ("network", "sphere")
        for k, v in getattr(model, part).state_dict().items()
    }


def largest_difference(model, other) -> float:
    before, after = weights(model), weights(other)
    return max(float((after[name] - value).abs().max()) for name, value in before.items())


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 3])
def test_processes_learn_what_one_learns(photos, count):
    losses = []
    one = train(photos, CONFIG, CPU, 3, Progress(on_step=lambda *step: losses.append(step[-1])))
    told = [[] for _ in range(count)]

    def learn(own):
        return train(
            photos, CONFIG, CPU, 3, Progress(on_step=lambda *step: told[own.rank].append(step[-1])), own
        )

    several = in_processes(count, learn)
    assert largest_difference(one, train(photos, replace(CONFIG, samples=256), CPU, 3)) > 100 * ROUNDING
    for model, heard in zip(several, told, strict=True):
        assert largest_difference(one, model) < ROUNDING
        assert largest_difference(several[0], model) == 0
        assert heard == pytest.approx(losses, rel=1e-5)


def test_the_loss_as_printed_is_shared_alike(photos):
    config = replace(
        CONFIG,
        steps=6,
        sphere_steps=0,
        loss_space=LossSpace.LINEAR,
        radiance_unit=RadianceUnit.PHOTO,
        samples=60,
    )
    few = [
        replace(photo, pixels=photo.pixels.take(torch.arange(3))) for photo in photos
    ]  # none for the fourth one
    for given in (photos, few):
        one = train(given, config, CPU, 3).network.state_dict()
        for model in in_processes(4, lambda own, given=given: train(given, config, CPU, 3, None, own)):
            for name, value in model.network.state_dict().items():
                torch.testing.assert_close(value, one[name], rtol=0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("killed_at", [14, 23])
def test_they_go_on_from_what_the_first_one_wrote(photos, tmp_path, killed_at):
    class KilledError(Exception):
        pass

    def kill(stage, step, *_):
        if (0 if stage == "network" else CONFIG.steps) + step == killed_at:
            raise KilledError

    def learn(own, on_step=None):
        return train(
            photos, CONFIG, CPU, 4, Progress(Checkpoints(tmp_path), on_step if own.first else None), own
        )

    with pytest.raises(KilledError):
        in_processes(2, lambda own: learn(own, kill))
    counted = []
    resumed = in_processes(2, lambda own: learn(own, lambda stage, step, *_: counted.append(step)))
    assert len(counted) == 28 - 10 * (killed_at // 10)
    assert largest_difference(train(photos, CONFIG, CPU, 4), resumed[0]) < ROUNDING


def test_checkpoints_that_not_all_see_are_refused(photos, tmp_path):
    config = replace(CONFIG, steps=2, checkpoint_every=2, sphere_steps=0)
    train(photos, config, CPU, 4, Progress(Checkpoints(tmp_path / "0")))
    with pytest.raises(InputError, match="must be one that all see"):
        in_processes(
            2, lambda own: train(photos, config, CPU, 4, Progress(Checkpoints(tmp_path / str(own.rank))), own)
        )


def test_more_processes_than_photos_of_a_step_are_refused(photos):
    with pytest.raises(ConfigError, match="6 processes cannot share the 5 photos"):
        in_processes(6, lambda own: train(photos, CONFIG, CPU, 3, None, own))
