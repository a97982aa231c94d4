"""How right `lightprobe insert` is: a second, smaller pot put into path-traced photos of the demo's coffee pot.

    python -m benchmarks insertion FOLDER [--run RUN] [--side 256] [--samples 512] [--cases hills studio hall]

Three scenes: the pot on a matt ground under a photographed light of the demo, seen by a camera of its own. The photo
is path-traced without the second object, rounded to 8 bits, and `insert` puts a GLB of the second object into it, once
with the true light, object and mask, and with `--run`, a run that learnt the pot, also with what the run predicts and
reconstructed. The truth is path-traced with both objects, at the place where `insert` put the second one.

PSNR in dB of displayed (sRGB) values, over the pixels that either changes by more than 3 of 255: all of them, and
apart those that the thing covers, those of the ground, and those of the pot. Pictures and scores.json go to FOLDER.
Mitsuba is needed (`pip install 'lightprobe[dev]'`) with an LLVM library newer than 15.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from PIL import Image

import demo_scene
from benchmarks import command_line
from benchmarks.insertion_scenes import CASES, Case, camera_of, moved, true_decomposition
from demo_scene.files import read_exr
from demo_scene.textures import Model, make_model
from lightprobe.core.files import write_json
from lightprobe.evaluation import relight
from lightprobe.export.bundle import write_mesh
from lightprobe.imaging import CLIPPED, read_ldr, srgb_encode, write_exr, write_png
from lightprobe.insertion import Insertion, PhotoView, Placement, insert, load_virtual_object
from lightprobe.insertion.placement import ground_height, place
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.prediction import Predictor
from lightprobe.scene.background import Background
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels

_CHANGED = 3 / 255
_MEAN = 0.3  # linear mean of the known object in a photo
_HDRI = Path(demo_scene.__file__).parent / "hdri"


@dataclass(frozen=True)
class Scene:
    """One path-traced scene and its files."""

    case: Case
    known: Decomposition
    camera: Camera
    environment: np.ndarray  # (h, 2h, 3) in the photo's exposure
    mask: np.ndarray  # (H, W) of the pot
    folder: Path

    @cached_property
    def photo(self) -> np.ndarray:
        """The photo without the second object (H, W, 3), linear, of 8 bits."""
        return read_ldr(self.folder / "photo.png")[0]

    @cached_property
    def truth(self) -> np.ndarray:
        """Both objects (H, W, 3), linear."""
        return read_exr(self.folder / "truth.exr", "RGB")


def make_scene(case: Case, folder: Path, side: int, samples: int) -> Scene:
    """Path-trace a scene into a folder, or read it from there."""
    pot = make_model(0)
    known = true_decomposition(pot)
    ground = ground_height(known.asset.mesh.vertices)
    camera = camera_of(case, side, ground)
    environment = np.roll(read_exr(_HDRI / f"{case.light}.exr", "RGB"), case.turn, axis=1)
    image, cover = relight(known, Environment.from_panorama(environment), camera)
    environment = environment * (_MEAN / float(image.sum() / (3 * cover.sum())))
    mask = cover.numpy()
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(known.asset, known.similarity, folder / "thing.glb")
    write_exr(folder / "light.exr", environment)
    write_json(folder / "camera.json", camera.to_json())
    write_png(folder / "mask.png", np.repeat(mask[..., None], 3, 2), srgb=False)
    scene = Scene(case, known, camera, environment, mask, folder)
    if not (folder / "truth.exr").exists():
        _trace(scene, pot, samples)
    return scene


def _trace(scene: Scene, pot: Model, samples: int) -> None:
    """Path-trace photo and truth into the scene's folder."""
    from benchmarks.insertion_truth import photograph

    thing, known, folder = load_virtual_object(scene.folder / "thing.glb"), scene.known, scene.folder
    wish = Placement(scale=scene.case.scale)
    placed = place(thing, known.asset.mesh.vertices, known.similarity, scene.camera, scene.mask, wish)
    there = moved(pot, *similarity(thing.vertices.numpy(), placed.virtual.vertices.numpy()))
    without = photograph(pot, None, scene.environment, scene.camera, placed.ground, samples)
    write_png(folder / "photo.png", without)
    write_exr(folder / "photo.exr", without)
    write_json(folder / "place.json", {"at": list(placed.at), "scale": placed.scale})
    write_exr(
        folder / "truth.exr", photograph(pot, there, scene.environment, scene.camera, placed.ground, samples)
    )


def similarity(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix (3, 3) and offset (3,) that take points (N, 3) to points (N, 3)."""
    both = np.concatenate([source, np.ones((len(source), 1))], 1).astype(np.float64)
    found = np.linalg.lstsq(both, target.astype(np.float64), rcond=None)[0]
    return found[:3].T, found[3]


def score(scene: Scene, inserted: Insertion) -> dict[str, float]:
    """Return the PSNR of an insertion over the pixels it or the truth changes, and of three parts of them."""
    before, mine, truth = (srgb_encode(v.clip(0, 1)) for v in (scene.photo, inserted.color, scene.truth))
    noise = srgb_encode(read_exr(scene.folder / "photo.exr", "RGB").clip(0, 1))
    changed = (np.abs(mine - before).max(-1) > _CHANGED) | (np.abs(truth - noise).max(-1) > _CHANGED)
    cover, pot = inserted.mask > 0.5, scene.mask > 0.5
    parts = {"all": changed, "thing": cover, "ground": changed & ~cover & ~pot, "pot": changed & pot & ~cover}
    square = np.square(mine - truth).mean(-1)
    found = {
        key: float(-10 * np.log10(square[part].mean())) for key, part in parts.items() if part.sum() > 20
    }
    return found | {"changed": float(changed.mean())}


def measure(scene: Scene, run: Path | None) -> dict[str, dict[str, float]]:
    """Return scores by light and object: true, and those of a run."""
    thing, view = (
        load_virtual_object(scene.folder / "thing.glb"),
        PhotoView(scene.photo, scene.mask, scene.camera),
    )
    anchor = json.loads((scene.folder / "place.json").read_text())
    wish = Placement(tuple(anchor["at"]), anchor["scale"])
    true = insert(scene.known, Environment.from_panorama(scene.environment), view, thing, wish)
    _show(scene, true, "true")
    scores = {"true light and object": score(scene, true)}
    if run is not None:
        predictor = Predictor.load(run)
        pixels = Pixels.of(scene.photo * (scene.mask[..., None] > 0), scene.mask)
        behind = Background.of(scene.photo, scene.photo >= CLIPPED, scene.mask, scene.camera)
        light = predictor.predict(pixels, scene.camera, background=behind).environment
        found = insert(predictor.decomposition, light, view, thing, wish)
        _show(scene, found, "predicted")
        scores["predicted light, reconstructed object"] = score(scene, found)
    return scores


def _show(scene: Scene, inserted: Insertion, name: str) -> None:
    """Write photo, insertion, truth and four times their difference side by side."""
    mine, truth = (srgb_encode(v.clip(0, 1)) for v in (inserted.color, scene.truth))
    row = np.concatenate([srgb_encode(scene.photo.clip(0, 1)), mine, truth, 4 * np.abs(mine - truth)], 1)
    Image.fromarray((row.clip(0, 1) * 255 + 0.5).astype(np.uint8)).save(scene.folder / f"{name}.png")


def write_picture(rows: Sequence[Path], path: Path) -> None:
    """Write photo, insertion and truth out of the scenes' pictures, one scene below the other."""
    parts = []
    for row in rows:
        with Image.open(row) as image:
            parts.append(np.asarray(image)[:, : 3 * image.height])
    Image.fromarray(np.concatenate(parts)).save(path, quality=80)


def main(words: Sequence[str]) -> None:
    """Read the command line and measure."""
    parser = command_line(__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--run", type=Path, metavar="RUN", help="a run that learnt the demo's coffee pot")
    parser.add_argument("--side", type=int, default=256, help="pixels of the photos")
    parser.add_argument("--samples", type=int, default=512, help="paths of a pixel")
    parser.add_argument("--cases", nargs="+", default=[case.name for case in CASES])
    parser.add_argument(
        "--picture", type=Path, metavar="P.jpg", help="photo, insertion and truth of all scenes"
    )
    given = parser.parse_args(words)
    torch.set_num_threads(1)
    scores = {}
    for case in (case for case in CASES if case.name in given.cases):
        scene = make_scene(case, given.folder / case.name, given.side, given.samples)
        scores[case.name] = measure(scene, given.run)
        for name, found in scores[case.name].items():
            told = ", ".join(f"{key} {value:.2f}" for key, value in found.items())
            print(f"{case.name}, {name}: {told}", flush=True)
    write_json(given.folder / "scores.json", scores)
    if given.picture is not None:
        name = "true" if given.run is None else "predicted"
        write_picture([given.folder / case / f"{name}.png" for case in scores], given.picture)
