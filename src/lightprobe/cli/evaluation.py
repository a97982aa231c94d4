"""eval: the numbers, the predictions and the report of a run."""

import sys
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import torch
from rich.console import Console
from rich.table import Column, Table
from tyro.conf import FlagCreatePairsOff

from lightprobe.cli import options
from lightprobe.cli.failures import writing
from lightprobe.cli.options import Device, RunArg, option
from lightprobe.cli.progress import Meter
from lightprobe.cli.stages import open_scene
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import InputError
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.core.stored import checked_object, read_object
from lightprobe.evaluation import (
    Evaluation,
    Protocols,
    ViewResult,
    can_be_oracle,
    evaluate,
    oracle_decomposition,
)
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.prediction import Method, methods_for, recorded_config
from lightprobe.report import Report, spread, view_pictures, write_report
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT
from lightprobe.report.run_info import read_phases, training_commands, training_facts
from lightprobe.scene.photo import Scene

# title -> the scores that fit side by side in 80 columns
_TABLES = {
    "The photos, re-rendered under the predicted light": tuple(IMAGES),
    "Predicted against true light: what it makes of objects": (
        "relit_psnr", "relit_psnr_scaled", "diffuse_si_rmse", "matte_si_rmse", "mirror_si_rmse",
    ),
    "Predicted against true light: the maps": (
        "light_log_rmse", "light_log_rmse_scaled", "light_log_rmse_channels",
    ),
}  # fmt: skip

_REMEDY = "remove it and evaluate again"
_METHODS = (
    "Methods to compare. Where the run has numbers of its default method, those of methods without it go to "
    "RUN/report/comparison and replace nothing."
)


def eval(  # the name of the command
    run: RunArg,
    *,
    methods: Annotated[tuple[Method, ...], option(help=_METHODS)] = (),
    output: Annotated[
        Path | None, option(aliases=["-o"], metavar="metrics.json", help="Numbers; also in the run.")
    ] = None,
    scene: Annotated[Path | None, option(metavar="FOLDER", help="Where the scene is now, if it has moved.")] = None,
    unseen: Annotated[bool, option(help="Also predict from half of the object and score on the other half.")] = True,
    oracle_asset: Annotated[
        FlagCreatePairsOff[bool],
        option(help="Put the scene's true object in place of the reconstructed one; results go to RUN/oracle."),
    ] = False,
    slow: Annotated[bool, option(help="Also score `optimize`, which takes 15 s to minutes a photo.")] = False,
    slow_photos: Annotated[int, option(help="Test photos that methods slower than 20 s a photo are scored on.")] = 4,
    settings: options.Prediction = options.UNCHANGED,
    device: Device = "auto",
) -> None:
    """Score the predicted light on the test photos and write metrics.json and report/index.html.

    Examples:
      lightprobe eval runs/cup
      lightprobe eval runs/cup --methods probe-mlp constant -o numbers.json
      lightprobe eval runs/chair --oracle-asset
    """
    chosen = Protocols(unseen=unseen, slow_photos=slow_photos)
    result = evaluate_run(
        RunFolder.open(run), resolve_device(device), methods=methods, scene_folder=scene, protocols=chosen,
        output=output, oracle=oracle_asset, slow=slow, settings=settings,
    )  # fmt: skip
    print_tables(result)


def evaluate_run(
    run: RunFolder, device: torch.device, *, methods: tuple[Method, ...] = (), scene_folder: Path | None = None,
    protocols: Protocols | None = None, output: Path | None = None, oracle: bool = False, slow: bool = False,
    settings: options.PredictionOptions = options.UNCHANGED,
) -> Evaluation:  # fmt: skip
    """Evaluate a run into its folder, or with the true object into its folder `oracle`, and name the report."""
    pictures: dict[str, dict[str, str]] = {}
    with writing(run), Meter() as meter:
        prediction = settings.over(recorded_config(run))
        decomposition = Decomposition.load(run, device)
        model = ProbeModel.load(run.model_folder).to(device) if ProbeModel.exists(run.model_folder) else None
        scene = open_scene(run, scene_folder)
        true_object = _true_object(run, decomposition, scene, needed=oracle)
        out = run.oracle if oracle else run
        every = methods_for(model, prediction)
        own, chosen = every[0], default_first((*(methods or every), *((Method.OPTIMIZE,) if slow else ())), every[0])
        numbers, page = destination(out, chosen, own)
        shown = set(spread([photo.name for photo in scene.test]))

        def keep(result: ViewResult) -> None:
            if result.view.photo.name in shown:
                pictures[result.view.photo.name] = view_pictures(result)

        result = evaluate(
            true_object if oracle and true_object is not None else decomposition, model, scene,
            methods=chosen, device=device, run=out, protocols=protocols, true_object=true_object,
            prediction=prediction, on_view=keep, on_photo=lambda done, total: meter.update("evaluate", done, total),
        )  # fmt: skip
        metrics = result.to_json()
        for path in {numbers, output or numbers}:
            write_json(path, metrics)
        phases = read_phases(run)
        again = eval_command(methods, protocols or Protocols(), settings, oracle=oracle, slow=slow)
        report = Report(
            title=f"lightprobe: {scene.root.name}{', true object' if oracle else ''}", metrics=metrics,
            pictures=pictures, facts=_facts(scene, decomposition) | training_facts(phases) | _made(),
            commands=[*training_commands(phases, scene.root), again] if phases else [],
            files=({} if oracle else {"object.glb": run.mesh_folder / "object.glb"}) | {"metrics.json": numbers},
            photo_files={name: _photo_files(out, name, chosen[0]) for name in pictures},
        )  # fmt: skip
        write_report(page, report)
    _warn(result)
    print(f"Report: {page}")
    if numbers != out.metrics_file:
        print(f"Numbers: {numbers} ({out.metrics_file} and its report keep those of {own.value})")
    return result


def _warn(result: Evaluation) -> None:
    """Print which photos are not scored or doubtful to standard error."""
    for photo, why in result.skipped.items():
        print(f"lightprobe: warning: test photo {photo} is not scored. {why}", file=sys.stderr)
    for photo, verdict in result.verdicts.items():
        for sentence in verdict.sentences:
            print(f"lightprobe: warning: test photo {photo} is doubtful. {sentence}", file=sys.stderr)


def default_first(methods: Sequence[Method], default: Method) -> tuple[Method, ...]:
    """Return the methods, each once, with the run's default one first if it is among them."""
    return tuple(sorted(dict.fromkeys(methods), key=lambda method: method is not default))


def destination(out: RunFolder, methods: Sequence[Method], default: Method) -> tuple[Path, Path]:
    """Return where the numbers and the page of `methods` go: never over those of the run's default method without it.

    The place beside them lies in the report's folder, which goes with the rest when a phase is restarted.
    """
    if out.metrics_file.is_dir():  # found out now, and not when all is computed
        raise InputError(f"{out.metrics_file} is a folder; {_REMEDY}.")
    if default in methods or not out.metrics_file.is_file():
        return out.metrics_file, out.report_file
    methods_there = read_object(out.metrics_file, _REMEDY).get("methods", {})
    if default.value not in checked_object(methods_there, out.metrics_file, _REMEDY, "methods"):
        return out.metrics_file, out.report_file
    folder = out.report_file.parent / "comparison"
    return folder / "metrics.json", folder / "index.html"


def eval_command(
    methods: Sequence[Method], protocols: Protocols, settings: options.PredictionOptions = options.UNCHANGED, *,
    oracle: bool, slow: bool,
) -> str:  # fmt: skip
    """Return the command line of an evaluation; RUN stands for the run's folder."""
    usual = Protocols()
    words = ["lightprobe eval RUN", *(["--methods", *(m.value for m in methods)] if methods else [])]
    words += ["--no-unseen"] if not protocols.unseen else []
    words += ["--oracle-asset"] if oracle else []
    words += ["--slow"] if slow else []
    words += [f"--slow-photos {protocols.slow_photos}"] if protocols.slow_photos != usual.slow_photos else []
    words += [f"--{name.replace('_', '-')} {value}" for name, value in settings.given().items()]
    return " ".join(words)


def _true_object(run: RunFolder, decomposition: Decomposition, scene: Scene, *, needed: bool) -> Decomposition | None:
    """Return the scene's true object, made once and kept in the run, or None where the scene does not bring it."""
    if not needed and not can_be_oracle(scene):
        return None
    return oracle_decomposition(decomposition, scene, run.oracle.asset_file)


def print_tables(evaluation: Evaluation) -> None:
    """Print the means of every method, the scores of the asset and the check of the confidence to standard output."""
    metrics = evaluation.to_json()
    rows = metrics["methods"]
    known = IMAGES | LIGHTS | MAPS
    for title, names in _TABLES.items():
        columns = {name: known[name] for name in names if any(name in row for row in rows.values())}
        if not columns:
            continue
        headings = (heading.name for heading in columns.values())
        table = Table(Column("method", no_wrap=True), *headings, title=title, title_justify="left", title_style="")
        for method, row in rows.items():
            table.add_row(method, *(h.text(row[name]) if name in row else "-" for name, h in columns.items()))
        Console().print(table)
    found = {heading: evaluation.truth[name] for name, heading in OBJECT.items() if name in evaluation.truth}
    if found:
        print("The object against ground truth; relighting is under known novel lights:")
    for heading, value in found.items():
        print(f"  {heading.name}: {heading.text(value)}")
    print(f"Photos whose verdict is doubtful: {metrics['verdicts']['doubtful']} of {len(metrics['photos'])}")
    for method, checked in metrics["confidence"].items():
        errors = " ".join(f"{part['log_rmse_scaled']:.2f}" for part in checked["bins"])
        trend = "falls" if checked["falls"] else "does not fall throughout"
        print(f"log-RMSE by confidence, {method}: {errors} ({trend})")


def _facts(scene: Scene, decomposition: Decomposition) -> dict[str, str]:
    return {
        "training photos": str(len(scene.train)),
        "test photos": str(len(scene.test)),
        "triangles": f"{len(decomposition.asset.mesh.faces):,}",
        "textures": f"{decomposition.asset.textures.size}²",
    }


def _made() -> dict[str, str]:
    return {"evaluated": datetime.now().strftime("%Y-%m-%d %H:%M"), "by lightprobe": version("lightprobe")}


def _photo_files(out: RunFolder, photo: str, method: Method) -> dict[str, Path]:
    """Return the files of a photo's prediction in the method's own folder, which no other method writes to."""
    suffixes = {"predicted light, EXR": ".exr", "confidence, EXR": ".confidence.exr"}
    return {name: out.prediction_file(photo, suffix, method.value) for name, suffix in suffixes.items()}
