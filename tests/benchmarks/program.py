"""A program whose commands take no time, for the bookkeeping of those who give them."""

import itertools
import json
from dataclasses import asdict, replace
from pathlib import Path

from lightprobe.core.config import settings
from lightprobe.core.run import RunFolder
from lightprobe.core.timings import PhaseTiming, write_timing
from lightprobe.models import LightAccuracy, ObjectVerdict


class Program:
    """Stands for the program: takes down the commands it is given, and writes the files that the true ones
    would.
    """

    def __init__(self):
        self.calls: list[list[str]] = []
        self.true_objects: set[str] = set()  # names of the scenes that bring their object
        self.fails = lambda words: False  # whether a command fails, which then leaves nothing

    def __call__(self, command) -> bool:
        words = list(command)
        if self.fails(words):
            return False
        self.calls.append(words)
        {"train": self._train, "distill": self._distill, "eval": self._evaluate}[words[0]](words)
        return True

    def _distill(self, words):
        assert RunFolder(Path(words[1])).asset_file.is_file()

    def _train(self, words):
        run = RunFolder.create(Path(words[words.index("-o") + 1]))
        given = dict(itertools.pairwise(words))
        options = {k: v for k, v in given.items() if k.startswith("--decompose.")}
        phase = settings(given["--preset"]).decompose
        passes = {name.partition(".")[2].replace("-", "_"): int(value) for name, value in options.items()}
        run.record_config("decompose", {"seed": int(given["--seed"]), **asdict(replace(phase, **passes))})
        second = settings(given["--preset"]).distill
        second = replace(second, steps=int(given.get("--distill.steps", second.steps)))
        run.record_config("distill", {"seed": int(given["--seed"]), **asdict(second)})
        for path in (run.asset_file, run.scene_file, run.model_folder / "config.json"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("{}")
        write_timing(run.timings_file, "decompose", PhaseTiming(630.2, None, True))
        ObjectVerdict(0.04, photos=5).save(run.verdict_file)
        LightAccuracy("probe-net+optimize", 16, 0.5, (0.05, 0.2, 0.6), 0.6, 0.7).save(run.model_folder)

    def _evaluate(self, words):
        run = RunFolder(Path(words[1]))
        run.oracle.path.mkdir(exist_ok=True)
        if run.path.name in self.true_objects:
            run.oracle.asset_file.parent.mkdir(exist_ok=True)
            run.oracle.asset_file.write_text("{}")
        run = run.oracle if "--oracle-asset" in words else run
        scores = {"psnr": 20.0 + len(self.calls), "ssim": 0.5}
        names = (
            words[words.index("--methods") + 1 :]
            if "--methods" in words
            else ("probe-net", "probe-mlp", "solve")
        )
        methods = {name: scores for name in names if not name.startswith("--")}
        value = {
            "methods": methods,
            "mean": scores,
            "default_method": next(iter(methods)),
            "photos": {"a": {"methods": methods}},
        }
        run.metrics_file.write_text(json.dumps(value))
