"""What is taken down of a phase while it trains: its steps, its lines in metrics.jsonl and log.txt, and its
time.
"""

import time

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.memory import peak_memory
from lightprobe.core.run import RunFolder
from lightprobe.core.timings import PhaseTiming, read_timings, write_timing
from lightprobe.reconstruction import OnStep, Progress
from lightprobe.runs.progress import OnProgress, clock

_RECORD_EVERY = 10  # steps between lines of metrics.jsonl
_LIGHTS = (
    "lights"  # the stage that only solves for the final lights: nothing is trained, no checkpoint is written
)


class PhaseRecorder:
    """Counts a phase's steps from its last checkpoint on, writes metrics.jsonl and timings.json and tells
    progress.
    """

    def __init__(self, run: RunFolder, phase: str, checkpoints: Checkpoints, on_progress: OnProgress):
        """Begin a call of the phase, whose checkpoints are `checkpoints`."""
        self._began = time.monotonic()
        latest = checkpoints.latest()
        self.run, self.phase, self.on_progress = run, phase, on_progress
        self.checkpoints = checkpoints
        self.count = latest[0] if latest else 0
        self._before = read_timings(run.timings_file).get(phase, PhaseTiming()) if latest else PhaseTiming()
        run.rewind_metrics(phase, self.count)
        run.log(f"{phase} goes on from step {self.count}" if latest else f"{phase} starts")

    def progress(self, on_step: OnStep) -> Progress:
        """Return what a training of the phase needs to hear: its time is written with each of its
        checkpoints.
        """
        return Progress(self.checkpoints, on_step, self.run.log, self._keep_timing, self.score)

    def step(self, stage: str, step: int, steps: int, loss: float) -> None:
        """Take note of one finished step."""
        trains = stage != _LIGHTS
        self.count += trains
        if trains and self.count % _RECORD_EVERY == 0:
            self.run.append_metrics(self.phase, self.count, {"stage": stage, "loss": loss})
        self.on_progress(stage, step, steps, f"loss {loss:.4f}" if trains else "")

    def score(self, stage: str, before: float, after: float) -> None:
        """Take note of the PSNR in dB of held-out photos before a finished stage and after it."""
        values: dict[str, float | str] = {
            "stage": stage,
            "held_out_before": round(before, 3),
            "held_out": round(after, 3),
        }
        self.run.append_metrics(
            self.phase, self.count, values, once=True
        )  # a resumed call scores the stage again

    def finish(self) -> None:
        """Take note that the phase is finished and its files are written."""
        memory = peak_memory()
        words = "" if memory is None else f", {memory:.2f} GiB at most"
        self.run.log(f"{self.phase} finished in {clock(time.monotonic() - self._began)}{words}")
        self._keep_timing(finished=True)

    def _keep_timing(self, *, finished: bool = False) -> None:
        """Write what this call and those before it took, as `core.timings` counts it."""
        held = [memory for memory in (self._before.memory, peak_memory()) if memory is not None]
        seconds = self._before.seconds + time.monotonic() - self._began
        write_timing(
            self.run.timings_file, self.phase, PhaseTiming(seconds, max(held, default=None), finished)
        )
