"""The run folder: the one place that knows the name of every file a run leaves behind.

RUN/config.json  scene.json  metrics.jsonl  log.txt
RUN/checkpoints/step-000001500/
RUN/mesh/object.glb  base_color.png  orm.png  normal.png  asset.safetensors
RUN/env/<photo>.exr
RUN/model/                       Phase II weights, config and checkpoints; light_accuracy.json
RUN/predictions/[<method>/]<photo>.exr .png .confidence.exr
RUN/calibration.json             absolute brightness, if `lightprobe calibrate` was told; see `models.calibration`
RUN/metrics.json
RUN/timings.json                 seconds and memory of each phase's training; see `core.timings`
RUN/report/index.html  page.json what the page shows; and comparison/: numbers and page of methods without the
default
RUN/oracle/                      the evaluation of a synthetic scene's true object, files named as in RUN
"""

import contextlib
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.config.stored import first_difference, plain, setting_of_one
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import (
    append_text,
    disk_errors,
    holds_files,
    locked_file,
    named_file,
    remove,
    write_bytes,
    write_json,
)
from lightprobe.core.partial import clear_run
from lightprobe.core.stored import checked_object, damaged, read_object
from lightprobe.core.timings import forget_timing

REMAKE = "put a copy of it back, or make the run anew with: lightprobe train SCENE -o RUN --restart"
RETRAIN = "train this phase anew with: lightprobe distill RUN --restart"


class RunFolder:
    """Paths, records and logs of one run. Making it touches no file; `create` and `open` check the folder."""

    def __init__(self, path: Path):
        self.path = Path(path)
        self.config_file = self.path / "config.json"  # the configuration of every phase that ran
        self.scene_file = self.path / "scene.json"  # cameras, similarity and input checksums
        self.metrics_log = self.path / "metrics.jsonl"  # one JSON object per line, written while training
        self.log_file = self.path / "log.txt"  # what happened, with the time of day; unexpected tracebacks
        self.checkpoints = Checkpoints(self.path / "checkpoints")  # of Phase I
        self.model_folder = self.path / "model"  # weights and configuration of Phase II
        self.model_checkpoints = Checkpoints(self.model_folder / "checkpoints")  # of Phase II
        self.mesh_folder = self.path / "mesh"  # in other programs' formats, and `asset_file`
        self.asset_file = self.mesh_folder / "asset.safetensors"  # normalised frame, full precision
        self.views_file = self.mesh_folder / "views.safetensors"  # what new photos are located by
        self.environment_folder = self.path / "env"  # Phase I environments, one EXR per training photo
        self.verdict_file = self.mesh_folder / "verdict.json"  # how far the object can be trusted
        self.calibration_file = self.path / "calibration.json"  # factor to true brightness, if it is known
        self.metrics_file = self.path / "metrics.json"  # the numbers of the evaluation
        self.timings_file = self.path / "timings.json"  # what the training of each phase took
        self.report_file = self.path / "report" / "index.html"  # the evaluation as one web page
        self._lock_file = self.path / ".lock"

    @staticmethod
    def create(path: Path) -> "RunFolder":
        """Return the run at `path`, making the folder when there is none.

        Raises `ConfigError` for a folder that holds something else than a run, `ResourceError` when another
        process is about to make it.
        """
        run = RunFolder(path)
        if run.path.exists() and not run.path.is_dir():
            raise ConfigError(f"{path} is a file; choose another run folder with -o.")
        if not run.config_file.exists() and holds_files(run.path):
            raise ConfigError(f"{path} is not empty and not a run folder; choose another one with -o.")
        with disk_errors(run.path):
            run.path.mkdir(parents=True, exist_ok=True)
        if not run.config_file.exists():
            run._begin()
        return run

    def _begin(self) -> None:
        """Write config.json under the lock, unless another process has been faster."""
        with self.writing():
            try:
                if not self.config_file.exists():
                    write_json(self.config_file, {})
            except BaseException:  # a folder in which nothing could be written is left as it was
                self._lock_file.unlink(missing_ok=True)
                raise

    @staticmethod
    def open(path: Path) -> "RunFolder":
        """Return the existing run at `path`; raise `InputError` when there is none."""
        run = RunFolder(path)
        if not run.config_file.is_file():
            raise InputError(
                f"{path} is not a run folder (no config.json); make one with: lightprobe train SCENE -o {path}"
            )
        return run

    # ---- paths

    @property
    def oracle(self) -> "RunFolder":
        """The evaluation with a synthetic scene's true object in place of the reconstructed one."""
        return RunFolder(self.path / "oracle")

    def environment_file(self, photo: str) -> Path:
        """Phase I environment of a training photo, in the user's frame."""
        return named_file(self.environment_folder, photo, ".exr")

    def prediction_file(self, photo: str, suffix: str, method: str | None = None) -> Path:
        """A prediction's file; `suffix` is `.exr`, `.png` or `.confidence.exr`; no method: the default one's."""
        folder = self.path / "predictions"
        return named_file(folder / method if method else folder, photo, suffix)

    # ---- what the run was started with

    def record_scene(self, scene: dict[str, Any]) -> None:
        """Write scene.json, or raise `ConfigError` unless the run was started with this very scene.

        The scene's folder, `root`, may have moved in between; everything else must be the same.
        """
        if self.scene_file.exists():
            moved = {**self.scene(), "root": scene["root"]}
            self._check_same(moved, plain(scene), "scene", "the photos, masks or cameras have changed")
        if not self.scene_file.exists() or self.scene()["root"] != scene["root"]:
            write_json(self.scene_file, scene)

    def record_config(self, phase: str, config: dict[str, Any]) -> None:
        """Write a phase's configuration into config.json, or raise `ConfigError` unless it is the same."""
        stored = self.sections()
        if phase in stored:
            alone = setting_of_one(stored[phase], config)
            if alone:
                raise ConfigError(
                    f"{self.path} was started by another version of lightprobe, whose settings of {phase} are others "
                    f"({alone}): choose another run folder, or start over with --restart."
                )
            self._check_same(stored[phase], plain(config), phase, "use the same options to go on")
        else:
            write_json(self.config_file, {**stored, phase: plain(config)})

    def config(self, phase: str) -> dict[str, Any]:
        """Return the stored configuration of a phase; raise `InputError` when the phase was never started."""
        stored = self.sections()
        if phase not in stored:
            raise InputError(f"{self.config_file} holds no '{phase}' section: this phase has not been run.")
        return checked_object(stored[phase], self.config_file, REMAKE, phase)

    def sections(self) -> dict[str, Any]:
        """Return the content of config.json, a section for each phase that was started."""
        return read_object(self.config_file, REMAKE)

    def scene(self) -> dict[str, Any]:
        """Return the content of scene.json, of which only `root` is checked; see `scene.record.read_record`."""
        record = read_object(self.scene_file, REMAKE)
        if not isinstance(record.get("root"), str) or "\0" in record["root"]:
            raise damaged(self.scene_file, "'root' names no folder", REMAKE)
        return record

    def restart(self, phase: str, *, outputs: tuple[Path, ...]) -> None:
        """Forget a phase: its configuration, timing, lines in metrics.jsonl, and the files and folders given."""
        remove(*outputs)
        write_json(self.config_file, {k: v for k, v in self.sections().items() if k != phase})
        self.rewind_metrics(phase, -1)
        forget_timing(self.timings_file, phase)

    def empty(self, *, outputs: tuple[Path, ...]) -> None:
        """Forget all phases, timings, metrics.jsonl and the given outputs, whatever state the files are in."""
        remove(*outputs, self.metrics_log, self.timings_file)
        write_json(self.config_file, {})

    def _check_same(self, stored: Any, given: Any, what: str, hint: str) -> None:
        difference = first_difference(stored, given, what)
        if difference:
            key, old, new = difference
            raise ConfigError(
                f"{self.path} was started with {key} = {old}, not {new}: {hint}, "
                "choose another run folder, or start over with --restart."
            )

    # ---- metrics and log

    def append_metrics(
        self, phase: str, step: int, values: Mapping[str, float | str], *, once: bool = False
    ) -> None:
        """Append one line to metrics.jsonl; with `once` only where it does not hold this very line.

        Times do not belong here: two equal runs leave equal files.
        """
        line = json.dumps({"phase": phase, "step": step, **values}, allow_nan=False)
        with disk_errors(self.metrics_log):
            written = self.metrics_log.read_bytes() if once and self.metrics_log.exists() else b""
            if line.encode() in written.splitlines():
                return
            append_text(self.metrics_log, line + "\n")

    def rewind_metrics(self, phase: str, step: int) -> None:
        """Drop the lines of `phase` beyond `step`, all that follows them, and a half-written last line."""
        if not self.metrics_log.exists():
            return
        kept = []
        for line in self.metrics_log.read_bytes().splitlines(keepends=True):
            place = _place(line)
            if place is None or (place[0] == phase and place[1] > step):
                break
            kept.append(line)
        write_bytes(self.metrics_log, b"".join(kept))

    def log(self, message: str) -> None:
        """Append a message with the time of day to log.txt."""
        with disk_errors(self.log_file):
            stamp = datetime.now().isoformat(sep=" ", timespec="seconds")
            append_text(self.log_file, f"{stamp}  {message}\n")

    # ---- one writer at a time

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the run for writing, after clearing away what a killed writer left half done.

        Raises `ResourceError` when another process holds it. The lock dies with its process.
        """
        busy = f"{self.path} is being written by another lightprobe process; wait for it to end."
        with locked_file(self._lock_file, busy):
            with disk_errors(self.path):
                clear_run(self.path)
            yield


def _place(line: bytes) -> tuple[str, int] | None:
    """Return (phase, step) of a line of metrics.jsonl, or None of one that is damaged or was cut short."""
    try:
        record = json.loads(line)
        place = (str(record["phase"]), int(record["step"]))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    return place if line.endswith(b"\n") else None
