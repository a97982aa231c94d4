"""The one way of descending that all trainings share: Phase I's passes, Phase II's networks, a prediction's
refinement.

`adam` moves named parameters, each group at its own rate. `descent` takes one step down a loss, on a GPU from
a recording. `loop` takes the steps of a stage, reports them, and writes and reads its checkpoints.
"""

from lightprobe.core import first_calls  # noqa: F401  (its import is its work)
from lightprobe.training.adam import Adam, ParameterGroup
from lightprobe.training.descent import Descent
from lightprobe.training.loop import Objective, Progress, Resumed, Stage, Training

__all__ = ["Adam", "Descent", "Objective", "ParameterGroup", "Progress", "Resumed", "Stage", "Training"]
