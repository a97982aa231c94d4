"""Steps that several processes take together."""

import pytest
import torch

from lightprobe.training import Descent, ParameterGroup, descent
from tests.shared_training import in_processes
from tests.tape import record_on_tape

TARGETS = torch.randn(7, 5, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


def learn(own=None, steps: int = 12) -> tuple[torch.Tensor, list[float]]:
    """Descend on the mean distance to seven points, of which `own` sees its part; return the place and the
    losses.
    """
    x = torch.zeros(5, dtype=torch.float64, requires_grad=True)
    scale = torch.ones((), dtype=torch.float64, requires_grad=True)
    points = TARGETS if own is None else TARGETS[own.part(7)]
    share = len(points) * (1 if own is None else own.count) / 7
    result = Descent(
        [ParameterGroup({"x": x}, 0.1), ParameterGroup({"scale": scale}, 0.02)],
        lambda shift: (scale * x + shift - points).square().sum(1).mean() * share,
        recordable=True,
        largest_gradient=1.0,
        **({} if own is None else {"processes": own}),
    )
    shift = torch.full((), 0.25, dtype=torch.float64)
    losses = [float(result.step(k, shift)) for k in range(steps)]
    return torch.cat([x.detach(), scale.detach().reshape(1)]), losses


@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize("count", [2, 3])
def test_processes_go_where_one_goes(count, recorded, monkeypatch):
    recorders = record_on_tape(monkeypatch, descent) if recorded else []
    place, losses = learn()
    for found, told in in_processes(count, learn):
        torch.testing.assert_close(found, place, rtol=1e-12, atol=1e-13)
        assert told == pytest.approx(losses, rel=1e-12)
    assert [recorder.replays for recorder in recorders] == ([9] + [18] * count if recorded else [])
