"""What a pass keeps in its checkpoints beside parameters goes there and back, in place."""

from dataclasses import dataclass, field, replace

import pytest
import torch
from lightprobe.reconstruction.pass_task import PassTask

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.reconstruction.lights import Lights

CONFIG = DecomposeConfig(light_resolution=8)


@dataclass
class Scale:
    """Unknowns with one chosen number."""

    factor: torch.Tensor = field(default_factory=lambda: torch.tensor(1.0))
    projected: int = 0

    def chosen(self):
        return {"factor": self.factor}

    def project(self):
        self.projected += 1


def task(update: LightUpdate) -> PassTask:
    made = PassTask()
    made.model = Scale()
    made.lights = Lights(["a", "b"], replace(CONFIG, light_update=update), torch.device("cpu"), 0)
    return made


def test_what_is_chosen_and_solved_comes_back():
    first, second = task(LightUpdate.SOLVE), task(LightUpdate.SOLVE)
    first.model.factor.fill_(3.0)
    first.lights.dim(0.25)
    held = second.model.factor
    second.load_buffers(first.buffers())
    assert second.model.factor is held
    assert float(held) == 3.0
    assert torch.equal(second.lights.stacked(), first.lights.stacked())
    with pytest.raises(KeyError):
        second.load_buffers({"lights": first.lights.stacked()})
    with pytest.raises(ValueError, match="'lights' are"):
        second.load_buffers({**first.buffers(), "lights": first.lights.stacked()[:1]})


def test_lights_fitted_by_gradients_are_no_buffers_and_stay_positive():
    fitted = task(LightUpdate.GRADIENT)
    assert fitted.buffers().keys() == {"factor"}
    with torch.no_grad():
        fitted.lights.maps[0].sub_(1.0)
    fitted.project()
    assert fitted.model.projected == 1
    assert float(fitted.lights.maps[0].detach().min()) == 0.0
