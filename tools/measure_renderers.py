"""How near pictures under known lights come to a scene's own renders, by either renderer: a table in
Markdown.

    python tools/measure_renderers.py DATA/synthetic/spot DATA/synthetic/chair [--runs RUNS] [--samples 1024]

Of scenes that bring their object and renders under novel lights. The rows of true objects show what a
renderer leaves to be gained (the true object's material is gathered from maps of the test photos:
`evaluation.oracle`); with --runs, the objects of the runs RUNS/SCENE follow. PSNR and SSIM of the object's
pixels, raw and after one factor per channel, and the seconds of all pictures.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import torch

from lightprobe.core.config.rendering import RenderConfig, Renderer
from lightprobe.core.run import RunFolder
from lightprobe.evaluation.oracle import true_asset
from lightprobe.evaluation.truth import relight_scores
from lightprobe.models import Decomposition
from lightprobe.scene import load_scene
from lightprobe.scene.photo import Scene

_CPU = torch.device("cpu")
_COLUMNS = ("relight_psnr", "relight_psnr_scaled", "relight_ssim", "relight_ssim_scaled")


def objects(scene: Scene, run: Path | None) -> Iterator[tuple[str, Decomposition]]:
    """Yield the objects that are measured, by name: the true one, and the run's if there is one."""
    yield f"{scene.root.name}, true object", Decomposition(true_asset(scene), {}, scene.similarity)
    if run is not None and run.is_dir():
        yield scene.root.name, Decomposition.load(RunFolder.open(run), _CPU)


def rows(scene: Scene, run: Path | None, samples: int) -> Iterator[str]:
    """Yield the table's rows of a scene."""
    for name, decomposition in objects(scene, run):
        for renderer in Renderer:
            start = time.monotonic()
            scores = relight_scores(decomposition, scene, _CPU, RenderConfig(renderer, samples))
            seconds = time.monotonic() - start
            values = [f"{scores[key]:.{2 if 'psnr' in key else 3}f}" for key in _COLUMNS]
            yield f"| {name} | {renderer.value} | " + " | ".join(values) + f" | {seconds:.0f} |"


def main() -> None:
    """Measure the scenes named on the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--runs", type=Path, help="folder of runs named as the scenes")
    parser.add_argument("--samples", type=int, default=1024, help="rays of a pixel")
    arguments = parser.parse_args()
    print("| object | renderer | PSNR, raw | scaled | SSIM, raw | scaled | seconds |", flush=True)
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: |", flush=True)
    for folder in arguments.scenes:
        run = None if arguments.runs is None else arguments.runs / folder.name
        for row in rows(load_scene(folder), run, arguments.samples):
            print(row, flush=True)


if __name__ == "__main__":
    main()
