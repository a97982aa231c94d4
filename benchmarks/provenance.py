"""What made a number: the commit, the machine and its threads, what a training took, a command without
folders.
"""

import math
import os
import platform
import re
import subprocess
from importlib.metadata import version
from pathlib import Path

import torch

from lightprobe.core.run import RunFolder
from lightprobe.core.timings import read_timings


def without_places(command: str, places: dict[str, Path]) -> str:
    """Return a command without this machine's folders: names stand for `places`, other absolute paths lose
    theirs.
    """
    spellings = {
        str(spelling): name for name, place in places.items() for spelling in (place, place.resolve())
    }
    for spelling in sorted(spellings, key=len, reverse=True):  # one place may lie inside another
        command = re.sub(rf"(?<!\S){re.escape(spelling)}(?=[/\\])", spellings[spelling], command)
    return re.sub(r"(?<!\S)(?:/|[A-Za-z]:[/\\])(?:\S*[/\\])?(?=\S)", "", command)


def training_costs(run: RunFolder) -> dict[str, float]:
    """Return the whole seconds of each finished phase of a run and the most memory (`memory`, GiB), from
    timings.json.

    What counts as a phase's time is said in `core.timings`. Empty for a run without such a record.
    """
    finished = {phase: timing for phase, timing in read_timings(run.timings_file).items() if timing.finished}
    costs: dict[str, float] = {phase: round(timing.seconds) for phase, timing in finished.items()}
    held = [timing.memory for timing in finished.values() if timing.memory is not None]
    return {**costs, "memory": round(max(held), 2)} if held else costs


def commit() -> str:
    """Return the commit of the checkout that the program runs from, or its version outside of one."""
    here = Path(__file__).resolve().parent
    questions = (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
    try:
        name, changes = (
            subprocess.run(
                ["git", "-C", str(here), *words], capture_output=True, text=True, check=True
            ).stdout.strip()
            for words in questions
        )
    except (OSError, subprocess.CalledProcessError):
        return f"version {version('lightprobe')}"
    return f"{name} with changes" if changes else name


def machine() -> str:
    """Return the processor, its cores, and the GPU if PyTorch sees one."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        models = re.findall(r"model name\s*: (.+)", info.read_text(encoding="utf-8", errors="replace"))
        name = models[0] if models else name
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory = f", {math.ceil(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30)} GiB"
    gpu = f", {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ", no GPU"
    return f"{name}, {os.cpu_count()} cores{memory}{gpu}, PyTorch {torch.__version__}"


def threads() -> str:
    """Return how many threads PyTorch computes with, and where that comes from if it was asked for."""
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return f"{torch.get_num_threads()}" + (f" (OMP_NUM_THREADS={asked})" if asked else "")
