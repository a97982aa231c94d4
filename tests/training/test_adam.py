"""The optimiser is PyTorch's Adam, with names."""

import pytest
import torch

from lightprobe.training import Adam, ParameterGroup

SHAPES, RATES = ((4, 3), (2,)), (0.1, 0.2)


def leaves() -> list[torch.Tensor]:
    return [torch.zeros(shape, requires_grad=True) for shape in SHAPES]


def named(parameters: list[torch.Tensor], **settings: float) -> list[ParameterGroup]:
    pairs = zip("ab", parameters, RATES, strict=True)
    return [ParameterGroup({name: parameter}, rate, **settings) for name, parameter, rate in pairs]


@pytest.mark.parametrize("fused", [True, False])
def test_steps_are_those_of_pytorch_bit_for_bit(fused):
    ours, theirs = leaves(), leaves()
    adam = Adam(named(ours), betas=(0.8, 0.95), epsilon=1e-3, fused=fused)
    groups = [{"params": [p], "lr": rate} for p, rate in zip(theirs, RATES, strict=True)]
    reference = torch.optim.Adam(groups, betas=(0.8, 0.95), eps=1e-3, fused=fused)
    random = torch.Generator().manual_seed(0)
    for step, share in enumerate((1.0, 0.7, 0.1)):
        for one, other in zip(ours, theirs, strict=True):
            one.grad = torch.randn(one.shape, generator=random)
            other.grad = one.grad.clone()
        if step == 1:
            ours[1].grad = theirs[1].grad = None  # it stays, and so do its moments
        adam.set_rates([share * rate for rate in adam.rates])
        for group, rate in zip(reference.param_groups, RATES, strict=True):
            group["lr"] = share * rate
        adam.step()
        reference.step()
    assert all(torch.equal(one, other) and one.any() for one, other in zip(ours, theirs, strict=True))


def test_damping_holds_values_that_the_loss_hardly_depends_on():
    gradient, moved = torch.tensor([1.0, 0.01]), {}
    for damping in (0.0, 1.0):
        x = torch.zeros(2, requires_grad=True)
        adam = Adam([ParameterGroup({"x": x}, 0.1, damping)])
        x.grad = gradient.clone()
        adam.step()
        moved[damping] = x.detach().clone()
    assert moved[0.0].tolist() == pytest.approx([-0.1, -0.1], rel=1e-5)
    size = float(gradient.square().mean().sqrt())
    assert moved[1.0].tolist() == pytest.approx([-0.1 * g / (g + size) for g in (1.0, 0.01)], rel=1e-5)


def test_a_state_goes_on_where_it_was_taken():
    first = leaves()
    adam, gradients = Adam(named(first)), [[torch.ones(s) * (k + 1) for s in SHAPES] for k in range(3)]

    def take(adam: Adam, parameters: list[torch.Tensor], k: int) -> None:
        for parameter, gradient in zip(parameters, gradients[k], strict=True):
            parameter.grad = gradient.clone()
        adam.step()

    take(adam, first, 0)
    stored = {name: tensor.clone() for name, tensor in adam.state().items()}
    kinds = ("parameter", "adam_mean", "adam_square", "adam_updates")
    assert stored.keys() == {f"{kind}.{name}" for kind in kinds for name in "ab"}
    other = leaves()
    resumed = Adam(named(other))
    resumed.load(stored)
    for k in (1, 2):
        take(adam, first, k)
        take(resumed, other, k)
    assert all(torch.equal(a, b) for a, b in zip(first, other, strict=True))
    with pytest.raises(KeyError):
        Adam(named(leaves())).load({k: v for k, v in stored.items() if k != "parameter.b"})
    with pytest.raises(ValueError, match=r"parameter\.a"):
        Adam(named(leaves())).load({**stored, "parameter.a": torch.zeros(5)})


def test_names_are_unique():
    with pytest.raises(ValueError, match="same name"):
        Adam([ParameterGroup({"x": p}, 0.1) for p in leaves()])
