"""What the verdict on several photos says of photos of one light, and of photos of different ones: a table in
Markdown.

    python tools/measure_one_light.py --data DATA --runs RUNS --scenes chair robot

DATA holds synthetic scene folders, RUNS a trained run of the same name for each; both are only read. Sets of
two to four photos: of each light of the relight split the first ones, and of the other photos, each of which
has a light of its own, ten sets drawn at random. `apart` is the verdict's (`prediction.verdict`); warned are
those above its limit.
"""

import argparse
import random
from collections.abc import Iterator, Sequence
from pathlib import Path

from lightprobe.prediction import Method, Predictor
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.photo import Photo, Scene
from measure_evidence import photos_of_one_light

_SIZES = (2, 3, 4)
_DRAWN = 10  # sets of each size


def of_one_light(scene: Scene, size: int) -> Iterator[list[Photo]]:
    """Yield the first `size` photos of each light of the relight split, and nothing of a light that has
    fewer.
    """
    for photos in photos_of_one_light(scene):
        if len(photos) >= size:
            yield photos[:size]


def of_different_lights(scene: Scene, size: int, seed: int) -> Iterator[list[Photo]]:
    """Yield sets of `size` test and training photos."""
    drawn = random.Random(seed)
    photos = [*scene.test, *scene.train]
    for _ in range(_DRAWN):
        yield drawn.sample(photos, size)


def judged(predictor: Predictor, photos: Sequence[Photo]) -> tuple[float, bool]:
    """Return how far apart the lights of photos are, and whether the verdict warns of it."""
    views = [load_pixels(photo) for photo in photos]
    verdict = predictor.predict_together(views, Method.CONSTANT, refuse=False)[0].verdict
    if verdict.apart is None:
        raise ValueError("One photo is not apart from itself.")
    return verdict.apart, verdict.of_different_lights


def row(name: str, kind: str, size: int, found: Sequence[tuple[float, bool]]) -> str:
    """Return a row of the table."""
    apart = sorted(value for value, _ in found)
    warned = sum(warning for _, warning in found)
    spread = f"{apart[0]:.2f} | {apart[len(apart) // 2]:.2f} | {apart[-1]:.2f}"
    return f"| {name} | {kind} | {size} | {len(found)} | {spread} | {warned} |"


def main() -> None:
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--scenes", nargs="+", required=True)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print("| scene | lights | photos | sets | apart, least | median | largest | warned |", flush=True)
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |", flush=True)
    for name in given.scenes:
        scene, predictor = load_scene(given.data / name), Predictor.load(given.runs / name)
        for size in _SIZES:
            kinds = {
                "one": of_one_light(scene, size),
                "different": of_different_lights(scene, size, given.seed),
            }
            for kind, sets in kinds.items():
                found = [judged(predictor, photos) for photos in sets]
                if found:
                    print(row(name, kind, size, found), flush=True)


if __name__ == "__main__":
    main()
