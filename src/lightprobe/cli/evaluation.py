"""eval: the numbers, the predictions and the report of a run."""

from pathlib import Path
from typing import Annotated

import torch
from rich.console import Console
from rich.table import Column, Table
from tyro.conf import FlagCreatePairsOff, arg

from lightprobe.cli.failures import writing
from lightprobe.cli.options import Device, RunArg
from lightprobe.cli.progress import Meter
from lightprobe.cli.stages import model_exists, open_scene
from lightprobe.core.device import resolve_device
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.decompose import Decomposition
from lightprobe.distill import ProbeModel
from lightprobe.evaluate import (
    Evaluation,
    Protocols,
    ViewResult,
    can_be_oracle,
    evaluate,
    oracle_decomposition,
    spread,
    view_pictures,
    write_report,
)
from lightprobe.predict import Method, methods_for
from lightprobe.scene.photo import Scene

# score -> (heading, decimals); "object": the object's pixels only, "unseen": the half the light was not predicted from,
# "relit": the object in other views under the predicted light against the true one, one factor per channel
_TABLES: tuple[dict[str, tuple[str, int]], ...] = (
    {
        "psnr": ("PSNR", 2),
        "ssim": ("SSIM", 3),
        "psnr_masked": ("PSNR object", 2),
        "ssim_masked": ("SSIM object", 3),
        "psnr_unseen": ("PSNR unseen", 2),
        "seconds": ("seconds", 2),
    },
    {
        "relit_psnr_scaled": ("relit PSNR", 2),
        "diffuse_si_rmse": ("diffuse", 3),
        "matte_si_rmse": ("matte", 3),
        "mirror_si_rmse": ("mirror", 3),
        "light_log_rmse": ("log-RMSE", 3),
        "light_log_rmse_scaled": ("scaled", 3),
    },
)


def eval(  # the name of the command
    run: RunArg,
    *,
    methods: Annotated[tuple[Method, ...], arg(help="Methods to compare, the default one first.")] = (),
    output: Annotated[
        Path | None, arg(aliases=["-o"], metavar="metrics.json", help="Numbers; also in the run.")
    ] = None,
    scene: Annotated[Path | None, arg(metavar="FOLDER", help="Where the scene is now, if it has moved.")] = None,
    unseen: Annotated[bool, arg(help="Also predict from half of the object and score on the other half.")] = True,
    oracle_asset: Annotated[
        FlagCreatePairsOff[bool],
        arg(help="Put the scene's true object in place of the reconstructed one; results go to RUN/oracle."),
    ] = False,
    slow: Annotated[bool, arg(help="Also score `optimize`, which takes a minute or more a photo.")] = False,
    slow_photos: Annotated[int, arg(help="Test photos that methods slower than 20 s a photo are scored on.")] = 4,
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
        output=output, oracle=oracle_asset, slow=slow,
    )  # fmt: skip
    print_tables(result)


def evaluate_run(
    run: RunFolder, device: torch.device, *, methods: tuple[Method, ...] = (), scene_folder: Path | None = None,
    protocols: Protocols | None = None, output: Path | None = None, oracle: bool = False, slow: bool = False,
) -> Evaluation:  # fmt: skip
    """Evaluate a run into its folder, or with the true object into its folder `oracle`, and name the report."""
    pictures: dict[str, dict[str, str]] = {}
    with writing(run), Meter() as meter:
        decomposition = Decomposition.load(run, device)
        model = ProbeModel.load(run.model_folder).to(device) if model_exists(run) else None
        scene = open_scene(run, scene_folder)
        true_object = _true_object(run, decomposition, scene, needed=oracle)
        out = run.oracle if oracle else run
        shown = set(spread([photo.name for photo in scene.test]))

        def keep(result: ViewResult) -> None:
            if result.view.photo.name in shown:
                pictures[result.view.photo.name] = view_pictures(result)

        result = evaluate(
            true_object if oracle and true_object is not None else decomposition, model, scene,
            methods=methods or (*methods_for(model), *((Method.OPTIMIZE,) if slow else ())), device=device, run=out,
            protocols=protocols, true_object=true_object,
            on_view=keep, on_photo=lambda done, total: meter.update("evaluate", done, total),
        )  # fmt: skip
        metrics = result.to_json()
        for path in {out.metrics_file, output or out.metrics_file}:
            write_json(path, metrics)
        title = f"lightprobe: {scene.root.name}{', true object' if oracle else ''}"
        write_report(out.report_file, metrics, pictures, _facts(scene, decomposition), title)
    print(f"Report: {out.report_file}")
    return result


def _true_object(run: RunFolder, decomposition: Decomposition, scene: Scene, *, needed: bool) -> Decomposition | None:
    """Return the scene's true object, made once and kept in the run, or None where the scene does not bring it."""
    if not needed and not can_be_oracle(scene):
        return None
    return oracle_decomposition(decomposition, scene, run.oracle.asset_file)


def print_tables(evaluation: Evaluation) -> None:
    """Print the means of every method, the scores of the asset and the check of the confidence to standard output."""
    metrics = evaluation.to_json()
    rows = metrics["methods"]
    for scores in _TABLES:
        columns = [name for name in scores if any(name in row for row in rows.values())]
        if not columns:
            continue
        table = Table(Column("method", no_wrap=True), *(scores[name][0] for name in columns))
        for method, row in rows.items():
            table.add_row(method, *(f"{row[name]:.{scores[name][1]}f}" if name in row else "-" for name in columns))
        Console().print(table)
    for name, value in evaluation.truth.items():
        print(f"{name}: {value:.4f}")
    for method, checked in metrics["confidence"].items():
        errors = " ".join(f"{part['log_rmse_scaled']:.2f}" for part in checked["bins"])
        verdict = "falls" if checked["falls"] else "does not fall throughout"
        print(f"log-RMSE by confidence, {method}: {errors} ({verdict})")


def _facts(scene: Scene, decomposition: Decomposition) -> dict[str, str]:
    return {
        "training photos": str(len(scene.train)),
        "test photos": str(len(scene.test)),
        "triangles": f"{len(decomposition.asset.mesh.faces):,}",
        "textures": f"{decomposition.asset.textures.size}²",
    }
