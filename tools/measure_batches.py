"""Measures whether predictions of several photos are faster together than one by one, on one thread of a CPU.

    OMP_NUM_THREADS=1 python tools/measure_batches.py RUN [--repeats N]

RUN: a run whose scene is still in place; its test photos are predicted from. First the parts of a prediction photo by
photo, for the default and for the single-step method, with the process's peak memory. Then what photos of one object
could share, per photo against their number N:

  sphere network   the six turns of N photos' maps as one batch of 6 N
  illumination MLP the probes of N photos as one batch of rows
  prefilter        one pass over the constant sparse matrix with the lights of N photos as 4 N columns, all rows
                   beside it the rows that one photo looks up, photo by photo
  linear map       what a step of the refinement does today for one photo (`render.transport`): the rows of that matrix
                   which its pixels look up, the shadows, and the look-ups themselves

The prefilter loads each entry once for N photos, the linear map none where no pixel looks. Prints Markdown tables.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numba
import numpy as np
import torch

from lightprobe.core.config.prediction import Method
from lightprobe.core.errors import LightprobeError
from lightprobe.core.memory import peak_memory
from lightprobe.core.run import RunFolder
from lightprobe.light import prefilter
from lightprobe.models.probe_maps import CHANNELS
from lightprobe.models.sphere_net import mean_over_turns
from lightprobe.prediction import Predictor
from lightprobe.prediction.observation import Observation, observe
from lightprobe.render.transport import Transport
from lightprobe.runs.phases import open_scene
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels

COUNTS = (1, 2, 4, 8, 16)
PARTS = ("rasterise", "verdict", "network", "stack", "solve", "confidence", "total")
TURNS = 6  # of a prediction's sphere network
PIXELS = 3072  # that a refinement fits the light to


def fastest(work: Callable[[], object], repeats: int) -> float:
    """Return the least of `repeats` wall times in ms, after one call that is not counted."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return 1000 * min(times)


def _wide_product(
    start: np.ndarray, column: np.ndarray, value: np.ndarray, x: np.ndarray, out: np.ndarray
) -> None:
    """Write a sparse product (M, 4 N) with x (columns, 4 N): every entry is loaded once for all columns."""
    for row in range(len(start) - 1):
        out[row] = 0
        for k in range(start[row], start[row + 1]):
            j, w = column[k], value[k]
            for c in range(x.shape[1]):
                out[row, c] += w * x[j, c]


wide_product: Callable[..., None] = numba.njit(fastmath={"contract"})(_wide_product)


def parts_of(
    predictor: Predictor, photos: Sequence[tuple[Pixels, Camera]], method: Method, repeats: int
) -> list[str]:
    """Return a table's row: the median ms of each part over all photos and repeats, and the peak memory in
    GiB.
    """
    runs = [predictor.predict(*photo, method).seconds for _ in range(repeats) for photo in photos]
    values = [1000 * float(np.median([seconds[name] for seconds in runs])) for name in PARTS]
    return [method.value, *(f"{value:.1f}" for value in values), f"{peak_memory() or 0:.2f}"]


def again(count: int, work: Callable[[torch.Tensor], object], light: torch.Tensor) -> None:
    """Do the work of `count` photos one after the other."""
    for _ in range(count):
        work(light)


def looked_up(operator: prefilter.Prefilter, seen: Observation) -> torch.Tensor:
    """Return the rows of the levels that a refinement's pixels look up, without their shadows' own."""
    few = seen.pixels.take(torch.arange(0, len(seen.pixels), max(len(seen.pixels) // PIXELS, 1)))
    mirrored = 2 * (few.normal * few.view).sum(-1, keepdim=True) * few.normal - few.view
    index = torch.cat(
        [operator.specular_taps(mirrored, few.roughness)[0], operator.diffuse_taps(few.normal)[0]], 1
    )
    return index.unique()


def shared(predictor: Predictor, photo: tuple[Pixels, Camera], repeats: int) -> dict[str, list[float]]:
    """Return ms per photo of every part that photos could share, for each of COUNTS."""
    model = predictor.model
    if model is None or model.sphere is None:
        raise LightprobeError("The run has no sphere network; train it with the preset quick.")
    sphere = model.sphere
    camera = photo[1].normalised(predictor.decomposition.similarity)
    seen = observe(
        predictor.decomposition.asset, photo[0], camera, predictor.device, predictor.config.max_pixels
    )
    probes = seen.pixels.take(torch.arange(0, len(seen.pixels), 4))
    light = seen.light_level.expand(6, 32, 32, 3).contiguous()
    operator = prefilter.cached(32)
    lobes = operator.lobes.forward
    arrays = tuple(part.numpy() for part in (lobes.start, lobes.column, lobes.value))
    transport = Transport(seen.gbuffer, operator, seen.rows[:: max(len(seen.rows) // PIXELS, 1)])
    part = prefilter.PrefilterPart(operator, looked_up(operator, seen))
    found: dict[str, list[float]] = {}

    def note(name: str, count: int, work: Callable[[], object]) -> None:
        found.setdefault(name, []).append(fastest(work, repeats) / count)

    for count in COUNTS:
        maps = torch.rand(TURNS * count, CHANNELS, 6, 16, 16)
        many = probes.take(torch.arange(len(probes)).repeat(count))
        x = np.random.default_rng(0).random((lobes.columns, 4 * count), np.float32)
        out = np.empty((len(arrays[0]) - 1, 4 * count), np.float32)
        note("sphere network", count, partial(sphere, maps))
        note("illumination MLP", count, partial(model.network, many, seen.light_level))
        note("prefilter, all rows, one pass", count, partial(wide_product, *arrays, x, out))
        note("prefilter, a photo's rows, one by one", count, partial(again, count, part.apply, light))
        note(
            "photo as a linear map of its light, one by one",
            count,
            partial(again, count, transport.apply, light),
        )
    found["sphere network, as a prediction calls it"] = [
        fastest(lambda: mean_over_turns(sphere, torch.rand(1, CHANNELS, 6, 16, 16), TURNS), repeats)
    ]
    return found


@torch.no_grad()
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        run = RunFolder.open(given.run)
        predictor = Predictor.load(run.path)
        photos = [load_pixels(photo) for photo in open_scene(run, None).test]
        print("| method | " + " | ".join(f"{name}, ms" for name in PARTS) + " | peak memory, GiB |")
        print("| --- |" + " ---: |" * (len(PARTS) + 1))
        for method in (Method.PROBE_NET_OPTIMIZE, Method.PROBE_NET):
            parts_of(predictor, photos[:1], method, 1)  # compiles
            print("| " + " | ".join(parts_of(predictor, photos, method, 1)) + " |", flush=True)
        print("\n| ms per photo, N photos together | " + " | ".join(map(str, COUNTS)) + " |")
        print("| --- |" + " ---: |" * len(COUNTS))
        for name, values in shared(predictor, photos[0], given.repeats).items():
            print(f"| {name} | " + " | ".join(f"{value:.2f}" for value in values) + " |")
        print(f"\npeak memory {peak_memory() or 0:.2f} GiB, {torch.get_num_threads()} thread(s)")
    except LightprobeError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
