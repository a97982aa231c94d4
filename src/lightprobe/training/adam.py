"""Adam on named parameters (Kingma & Ba 2015), each group of them at a rate of its own.

    m <- b1 m + (1 - b1) g,   v <- b2 v + (1 - b2) g^2,   x <- x - rate  m' / (sqrt(v') + epsilon)

m' and v' are m and v over 1 - b1^t and 1 - b2^t. Adam moves a parameter by about its rate at each step,
however large its gradient is, so a rate is in the parameter's own unit. With damping, epsilon is at least
that share of the root mean square of the group's first gradient: values that the loss hardly depends on then
move less than the others.

The arithmetic is PyTorch's function and not its class: the first use of any `torch.optim.Optimizer` imports
PyTorch's compiler, two seconds, of which a prediction in a new process would be the longest part.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.optim.adam import adam

from lightprobe.core.checkpoint import stored_like

_MEAN, _SQUARE, _UPDATES = "adam_mean", "adam_square", "adam_updates"  # prefixes in a checkpoint


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters by name, and by how much a step moves them."""

    parameters: Mapping[str, Tensor]  # each requires a gradient
    rate: float  # in the parameters' own unit, before the schedule
    damping: float = 0.0  # relative to the root mean square of the first gradient


@dataclass
class _Moments:
    mean: Tensor  # of the gradient, shape of the parameter
    square: Tensor  # mean of its square
    updates: Tensor  # () float32


class Adam:
    """The optimiser: parameters, their rates, and the moments of their gradients, all by name."""

    def __init__(
        self,
        groups: Sequence[ParameterGroup],
        *,
        betas: tuple[float, float] = (0.9, 0.999),
        epsilon: float = 1e-8,
        fused: bool = True,
        recordable: bool = False,
    ):
        """Take the groups; no two parameters may share a name.

        fused: one kernel for a whole group; both ways round differently. recordable: all numbers that change
        are held in tensors on the parameters' device, where a recording of a step reads them; needs a GPU.
        """
        self.parameters = {name: p for group in groups for name, p in group.parameters.items()}
        if len(self.parameters) < sum(len(group.parameters) for group in groups):
            raise ValueError("two parameters have the same name")
        self._groups, self._betas, self._fused, self._recordable = list(groups), betas, fused, recordable
        self._moments: dict[str, _Moments] = {}
        self._epsilons = [epsilon if group.damping == 0 else None for group in groups]
        self._least_epsilon = epsilon
        self._rates: list[float | Tensor] = [group.rate for group in groups]
        if recordable:
            devices = [next(iter(group.parameters.values())).device for group in groups]
            self._rates = [torch.tensor(g.rate, device=d) for g, d in zip(groups, devices, strict=True)]

    @property
    def rates(self) -> list[float]:
        """The rates of the groups before any schedule."""
        return [group.rate for group in self._groups]

    def set_rates(self, rates: Sequence[float]) -> None:
        """Set the rates of the next steps, in place where a recording reads them."""
        for i, rate in enumerate(rates):
            held = self._rates[i]
            if isinstance(held, Tensor):
                held.fill_(rate)
            else:
                self._rates[i] = rate

    def forget_gradients(self) -> None:
        """Let go of all gradients."""
        for parameter in self.parameters.values():
            parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Move every parameter that has a gradient; the others stay, and so do their moments."""
        for i, group in enumerate(self._groups):
            moving = {name: p for name, p in group.parameters.items() if p.grad is not None}
            if not moving:
                continue
            gradients = [p.grad.contiguous() for p in moving.values() if p.grad is not None]
            moments = [self._moments_of(name, p) for name, p in moving.items()]
            rate = self._rates[i]
            adam(
                list(moving.values()),
                gradients,
                [m.mean for m in moments],
                [m.square for m in moments],
                [],
                [m.updates for m in moments],
                amsgrad=False,
                beta1=self._betas[0],
                beta2=self._betas[1],
                lr=rate,
                weight_decay=0.0,
                eps=self._epsilon(i, gradients),
                maximize=False,
                fused=self._fused,
                capturable=self._recordable,
            )

    def _epsilon(self, i: int, gradients: list[Tensor]) -> float:
        """Return the epsilon of a group, found at its first step where it is damped."""
        found = self._epsilons[i]
        if found is None:
            every = torch.cat([gradient.reshape(-1) for gradient in gradients])
            found = max(self._groups[i].damping * float(every.square().mean().sqrt()), self._least_epsilon)
            self._epsilons[i] = found
        return found

    def _moments_of(self, name: str, parameter: Tensor) -> _Moments:
        if name not in self._moments:
            device = parameter.device if self._fused or self._recordable else None
            mean, square = (
                torch.zeros_like(parameter, memory_format=torch.preserve_format) for _ in range(2)
            )
            self._moments[name] = _Moments(mean, square, torch.zeros((), device=device))
        return self._moments[name]

    def state(self) -> dict[str, Tensor]:
        """Return what a checkpoint holds: `parameter.<name>`, and `adam_mean.<name>` and so on once moved."""
        tensors = {_parameter(name): p.detach() for name, p in self.parameters.items()}
        for name, moments in self._moments.items():
            tensors |= {f"{_MEAN}.{name}": moments.mean, f"{_SQUARE}.{name}": moments.square}
            tensors[f"{_UPDATES}.{name}"] = moments.updates
        return tensors

    @torch.no_grad()
    def load(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over a `state` of the same parameters, which may hold other tensors besides.

        Raises `KeyError` or `ValueError` where it does not fit.
        """
        for name, parameter in self.parameters.items():
            parameter.copy_(stored_like(tensors, _parameter(name), parameter))
            if f"{_MEAN}.{name}" in tensors:
                mean, square = (stored_like(tensors, f"{key}.{name}", parameter) for key in (_MEAN, _SQUARE))
                moments = self._moments_of(name, parameter)
                updates = stored_like(tensors, f"{_UPDATES}.{name}", moments.updates)
                self._moments[name] = _Moments(mean, square, updates)


def _parameter(name: str) -> str:
    return f"parameter.{name}"
