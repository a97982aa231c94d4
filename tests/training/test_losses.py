import pytest
import torch

from lightprobe.training.losses import LossReader


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


def test_who_hears_of_a_loss_may_refuse_it():
    def refuse(value: float) -> None:
        raise ValueError(f"{value}")

    losses = LossReader(torch.device("cuda", 0))
    losses.add(torch.tensor(float("nan")), refuse)
    with pytest.raises(ValueError, match="nan"):
        losses.read()
