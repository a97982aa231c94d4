"""fleet train, fleet predict: many scenes and many photos as tasks of a Ray cluster."""

import os
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from lightprobe.cli.answer import say
from lightprobe.cli.options import Prediction, Seed, option
from lightprobe.cli.progress import Meter
from lightprobe.cli.training import PresetArg, with_preset
from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset
from lightprobe.core.config.prediction import UNCHANGED, PredictConfig
from lightprobe.core.errors import InputError
from lightprobe.fleet.executor import Needs
from lightprobe.fleet.predicting import CHUNK, predict_fleet
from lightprobe.fleet.ray_cluster import cluster
from lightprobe.fleet.training import SceneOptions, train_fleet
from lightprobe.jobs import LightOptions

__all__ = ["fleet_predict", "fleet_train", "with_preset"]

_Address = Annotated[
    str | None,
    option(
        metavar="HOST:PORT|auto",
        help="A Ray cluster that runs, a private one; else one is made on this machine.",
    ),
]
_Scenes = Annotated[
    Positional[str], option(metavar="SCENES", help="Folder with a folder for each scene, or its URL.")
]
_Runs = Annotated[str, option(aliases=["-o"], metavar="RUNS", help="Folder for the runs, or its URL.")]
_Hdri = Annotated[
    str | None,
    option(
        metavar="DIR",
        help="Folder of .exr or .hdr environments that every machine sees, to train under as well.",
    ),
]
_Evaluate = Annotated[
    FlagCreatePairsOff[bool],
    option(help="Also score each run on its test photos, by the method that it uses."),
]
_Table = Annotated[
    Positional[str],
    option(
        metavar="PHOTOS.parquet",
        help="A row for each photo: run, photo, and camera, mask, id, method, ...; or its URL.",
    ),
]
_Out = Annotated[str, option(aliases=["-o"], metavar="OUT", help="Folder for maps and index, or its URL.")]
_Chunk = Annotated[int, option(metavar="N", help="Photos of one object that a task predicts from, at most.")]
_Retry = Annotated[FlagCreatePairsOff[bool], option(help="Try those photos again that have failed.")]
_Confidence = Annotated[FlagCreatePairsOff[bool], option(help="Also write the confidence of each map.")]

# `with_preset` puts the chosen preset's in their place
_FIRST, _SECOND, _THIRD = DecomposeConfig(), DistillConfig(), PredictConfig()
_NEEDS, _OPTIONS = Needs(), LightOptions()


def fleet_train(
    scenes: _Scenes,
    *,
    output: _Runs,
    address: _Address = None,
    needs: Needs = _NEEDS,
    preset: PresetArg = Preset.QUICK,
    seed: Seed = 0,
    hdri: _Hdri = None,
    evaluate: _Evaluate = False,
    decompose: DecomposeConfig = _FIRST,
    distill: DistillConfig = _SECOND,
    predict: PredictConfig = _THIRD,
) -> None:
    """Train a run for every scene of a folder, on this machine or on a Ray cluster.

    RUNS/index.parquet says what became of each scene. The same command goes on where an interrupted one stopped; where
    a machine dies, its scenes go on elsewhere from their checkpoints. With --needs.gpus a task computes on a GPU.
    Needs the extra lightprobe[cluster].

    Examples:
      lightprobe fleet train scenes -o runs
      lightprobe fleet train scenes -o runs --evaluate --needs.cpus 4
      lightprobe fleet train s3://bucket/scenes -o s3://bucket/runs --address auto --preset standard --needs.gpus 1
    """
    maps = None if hdri is None else os.path.abspath(hdri)  # machines of a cluster work in other folders
    options = SceneOptions(decompose, distill, predict, seed, maps, evaluate)
    with cluster(address) as executor, Meter() as meter:
        found = train_fleet(scenes, output, executor, options, needs=needs, on_progress=meter.update)
    failures = found.failures
    say(
        f"{len(found.rows) - len(failures)} of {len(found.rows)} scenes have a run\nIndex: {found.index}",
        scenes=len(found.rows),
        failed=failures,
        index=found.index,
    )
    if failures:
        some = " ".join(f"{name}: {reason}" for name, reason in list(failures.items())[:3])
        raise InputError(
            f"{len(failures)} of {len(found.rows)} scenes have no run; reasons stand in the index. {some}"
        )


def fleet_predict(
    table: _Table,
    *,
    output: _Out,
    address: _Address = None,
    needs: Needs = _NEEDS,
    chunk: _Chunk = CHUNK,
    retry_failed: _Retry = False,
    confidence: _Confidence = False,
    options: Annotated[LightOptions, arg(name="")] = _OPTIONS,
    settings: Prediction = UNCHANGED,
) -> None:
    """Predict the environments of all photos that a Parquet file lists, on this machine or on a Ray cluster.

    OUT/maps has the maps, OUT/index a row for each photo with its map, verdict and confidence, or why it has
    none. The same command goes on where an interrupted one stopped. Needs the extra lightprobe[cluster].

    Examples:
      lightprobe fleet predict photos.parquet -o out
      lightprobe fleet predict photos.parquet -o out --method probe-net --chunk 100
      lightprobe fleet predict s3://bucket/photos.parquet -o s3://bucket/out --address auto
    """
    with cluster(address) as executor, Meter() as meter:
        found = predict_fleet(
            table,
            output,
            executor,
            options=options,
            confidence=confidence,
            settings=settings,
            needs=needs,
            chunk=chunk,
            retry_failed=retry_failed,
            on_progress=meter.update,
        )
    say(
        f"{found.done} of {found.photos} photos have a map\nIndex: {found.index}",
        photos=found.photos,
        done=found.done,
        failed=found.failed,
        index=found.index,
    )
    if found.failed:
        raise InputError(
            f"{found.failed} of {found.photos} photos have no map; the column 'reason' of {found.index} says why."
        )
