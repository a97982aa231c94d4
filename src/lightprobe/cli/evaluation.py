"""eval: the numbers, the predictions and the report of a run."""

from pathlib import Path
from typing import Annotated

import torch
from rich.console import Console
from rich.table import Column, Table
from tyro.conf import arg

from lightprobe.cli.failures import writing
from lightprobe.cli.options import Device, RunArg
from lightprobe.cli.progress import Meter
from lightprobe.cli.stages import model_exists, open_scene
from lightprobe.core.device import resolve_device
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.decompose import Decomposition
from lightprobe.distill import ProbeModel
from lightprobe.evaluate import Evaluation, ViewResult, evaluate, spread, view_pictures, write_report
from lightprobe.predict import Method, methods_for
from lightprobe.scene.photo import Scene

# score -> (heading, decimals); "object": the object's pixels only, "unseen": the half the light was not predicted from
_TABLE = {
    "psnr": ("PSNR", 2),
    "ssim": ("SSIM", 3),
    "psnr_masked": ("PSNR object", 2),
    "ssim_masked": ("SSIM object", 3),
    "psnr_unseen": ("PSNR unseen", 2),
    "light_log_rmse": ("light error", 3),
    "seconds": ("seconds", 2),
}


def eval(  # the name of the command
    run: RunArg,
    *,
    methods: Annotated[tuple[Method, ...], arg(help="Methods to compare, the default one first.")] = (),
    output: Annotated[
        Path | None, arg(aliases=["-o"], metavar="metrics.json", help="Numbers; also in the run.")
    ] = None,
    scene: Annotated[Path | None, arg(metavar="FOLDER", help="Where the scene is now, if it has moved.")] = None,
    unseen: Annotated[bool, arg(help="Also predict from half of the object and score on the other half.")] = True,
    device: Device = "auto",
) -> None:
    """Score the predicted light on the test photos and write metrics.json and report/index.html.

    Examples:
      lightprobe eval runs/cup
      lightprobe eval runs/cup --methods probe-mlp constant -o numbers.json
    """
    folder = RunFolder.open(run)
    evaluate_run(folder, resolve_device(device), methods=methods, scene_folder=scene, unseen=unseen, output=output)


def evaluate_run(
    run: RunFolder, device: torch.device, *, methods: tuple[Method, ...] = (), scene_folder: Path | None = None,
    unseen: bool = True, output: Path | None = None,
) -> None:  # fmt: skip
    """Evaluate a run into its folder, print the table, and name the report."""
    pictures: dict[str, dict[str, str]] = {}
    with writing(run), Meter() as meter:
        decomposition = Decomposition.load(run, device)
        model = ProbeModel.load(run.model_folder).to(device) if model_exists(run) else None
        scene = open_scene(run, scene_folder)
        shown = set(spread([photo.name for photo in scene.test]))

        def keep(result: ViewResult) -> None:
            if result.view.photo.name in shown:
                pictures[result.view.photo.name] = view_pictures(result)

        result = evaluate(
            decomposition, model, scene, methods=methods or methods_for(model), device=device, run=run,
            unseen=unseen, on_view=keep, on_photo=lambda done, total: meter.update("evaluate", done, total),
        )  # fmt: skip
        metrics = result.to_json()
        for path in {run.metrics_file, output or run.metrics_file}:
            write_json(path, metrics)
        write_report(run.report_file, metrics, pictures, _facts(scene, decomposition), f"lightprobe: {scene.root.name}")
    print_table(result)
    print(f"Report: {run.report_file}")


def print_table(evaluation: Evaluation) -> None:
    """Print the means of every method to standard output."""
    rows = evaluation.to_json()["methods"]
    columns = [name for name in _TABLE if any(name in row for row in rows.values())]
    table = Table(Column("method", no_wrap=True), *(_TABLE[name][0] for name in columns))
    for method, row in rows.items():
        table.add_row(method, *(f"{row[name]:.{_TABLE[name][1]}f}" if name in row else "-" for name in columns))
    Console().print(table)
    for name, value in evaluation.truth.items():
        print(f"{name}: {value:.4f}")


def _facts(scene: Scene, decomposition: Decomposition) -> dict[str, str]:
    return {
        "training photos": str(len(scene.train)),
        "test photos": str(len(scene.test)),
        "triangles": f"{len(decomposition.asset.mesh.faces):,}",
        "textures": f"{decomposition.asset.textures.size}²",
    }
