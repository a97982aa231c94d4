"""The runs of a benchmark: whether one is finished, what it was trained with, and the options of the paper's."""

import re
import shutil
from collections.abc import Sequence

from lightprobe.core.config import Preset, settings
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.report.run_info import fitted_preset, read_phases
from lightprobe.runs.phases import is_learnt


def is_finished(run: RunFolder) -> bool:
    """Return whether both phases of a run are done."""
    return run.asset_file.is_file() and is_learnt(run)


def check_trained(run: RunFolder, options: Sequence[str]) -> None:
    """Raise `ConfigError` unless a finished run was trained with the `options`, names and values in turn,
    alone.

    Of a run whose settings this version cannot read, the preset is not known, and other settings are not
    seen.
    """
    given = dict(zip(options[::2], options[1::2], strict=True))
    remedy = "remove it, or choose another with -o or --runs"
    for option, wanted in given.items():
        section, _, key = option.removeprefix("--").replace("-", "_").rpartition(".")
        if key == "preset":
            found = {fitted_preset(run).value}
        else:
            found = {
                str(run.config(name).get(key))
                for name in ([section] if section else ("decompose", "distill"))
            }
        if found != {wanted}:
            told = " and ".join(sorted(found))
            raise ConfigError(f"{run.path} was trained with {option} {told}, not {wanted}; {remedy}.")
    asked = {f"{option} {value}" for option, value in given.items()}
    for phase in read_phases(run):
        for changed in phase.options(given["--preset"]):
            if changed not in asked:
                raise ConfigError(f"{run.path} was trained with {changed} as well; {remedy}.")


def paper_options(first: int, second: int) -> tuple[tuple[str, ...], str]:
    """Return the options of a training with the paper's settings and at most so many iterations, and these in
    words.

    first: of each pass that Phase I has with these settings; second: of Phase II. More than the paper's are
    cut to its.
    """
    paper = settings(Preset.PAPER)
    passes = {f"pass{i}_iterations": getattr(paper.decompose, f"pass{i}_iterations") for i in (1, 2, 3)}
    used = {name: (min(first, most), most) for name, most in passes.items() if most}
    steps = paper.distill.steps
    options = ["--preset", Preset.PAPER.value]
    for name, (count, _) in used.items():
        options += [f"--decompose.{name.replace('_', '-')}", str(count)]
    options += ["--distill.steps", str(min(second, steps))]
    phases = [*dict.fromkeys(used.values()), (min(second, steps), steps)]
    words = [f"{count} of {most}" if count < most else str(most) for count, most in phases]
    return tuple(options), re.sub(r"(?<=\d\d)(?=\d{3}\b)", " ", " + ".join(words))


def share_phase_one(source: RunFolder, run: RunFolder) -> None:
    """Make `run` a run with the finished Phase I of `source` and no Phase II; an existing one is left alone."""
    if run.config_file.is_file():
        return
    shutil.copytree(source.mesh_folder, run.mesh_folder, dirs_exist_ok=True)
    shutil.copyfile(source.scene_file, run.scene_file)
    write_json(run.config_file, {"decompose": source.config("decompose")})
