"""How well new photos are located: poses, light, and photos without the object.

    python -m benchmarks locate --data DATA [--runs RUNS] --scenes spot chair [--tables poses free light wrong]
        [--others vase cape]

DATA holds scene folders, RUNS a trained run of the same name for each of --scenes; without it the true objects are
located, which tells what matching and refining lose from what the reconstruction does, and takes no training. Test
photos with a true environment are laid over it (`benchmarks.composed`), others are taken as they are; neither camera nor mask is given. Tables:

    poses   the focal length is known: mean distance, in pixels of a photo with 320 on its longer side, between where
            the found and the given camera see the mesh's vertices that the given camera sees
    free    the same with the focal length unknown
    light   maps of located photos beside maps with the given camera and mask: the three spheres' errors against the
            true light, and the PSNR of another view rendered under both lights, against the true one
    wrong   photos without the object: composed photos of the other scenes and of --others, which need no run,
            backgrounds alone, noise

A wrong pose is one that is off by more than 3 pixels; it is silent when its verdict is good.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks import command_line
from benchmarks.composed import background, composed
from benchmarks.run import find_scene
from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import relight
from lightprobe.evaluation.metrics import psnr
from lightprobe.evaluation.oracle import true_asset
from lightprobe.evaluation.true_light import TrueLight
from lightprobe.imaging import read_hdr, srgb_encode, write_png
from lightprobe.light.environment import Environment
from lightprobe.localization import KnownViews, Located, Locator, PoseStatus, stored_views
from lightprobe.models import Decomposition
from lightprobe.prediction import Predictor
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Scene

_WRONG = 3.0  # pixels of 320
_OTHERS, _BACKGROUNDS, _NOISE = 4, 6, 4  # photos of each other scene, and without any object
CPU = torch.device("cpu")


@dataclass(frozen=True)
class Subject:
    """A scene, its run, and its test photos as files without camera and mask."""

    name: str
    scene: Scene
    decomposition: Decomposition
    locator: Locator
    predictor: Predictor | None  # of a run
    files: dict[str, Path]  # by the photo's name

    @staticmethod
    def of(name: str, data: Path, runs: Path | None, folder: Path) -> "Subject":
        """Load a scene and its run or its true object, and write its photos into `folder`."""
        scene = scene_of(name, data)
        files = dict(photo_files(name, scene, folder))
        if runs is None:
            known = Decomposition(true_asset(scene), {}, scene.similarity)
            return Subject(name, scene, known, Locator(known, KnownViews.of(known, scene)), None, files)
        run = RunFolder.open(runs / name)
        predictor = Predictor.load(run.path)
        known = predictor.decomposition
        return Subject(name, scene, known, Locator(known, stored_views(run, known)), predictor, files)


def scene_of(name: str, data: Path) -> Scene:
    """Load the scene of a name in `data` or one folder down."""
    folder = find_scene(data, name)
    if folder is None:
        raise SystemExit(f"There is no scene {name} in {data}.")
    return load_scene(folder)


def photo_files(name: str, scene: Scene, folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield name and file of the test photos, composed over their lights where these are known."""
    for photo in scene.test:
        file = photo.image_path
        if photo.truth.environment is not None:
            file = folder / name / f"{photo.name}.png"
            write_png(file, composed(photo))
        yield photo.name, file


def pose_error(subject: Subject, found: Camera, given: Camera) -> float:
    """Return the mean distance of two input-frame cameras at vertices that `given` sees, in pixels of 320."""
    similarity, mesh = subject.decomposition.similarity, subject.decomposition.asset.mesh
    scale = 320 / max(given.width, given.height)
    small = given.resized(max(1, round(scale * given.width)), max(1, round(scale * given.height)))
    surface = visible_surface(mesh.vertices, mesh.faces, View.of(small.normalised(similarity), CPU))
    points = similarity.invert(surface.position.numpy())
    other = found.resized(small.width, small.height)
    return float(np.linalg.norm(small.project(points)[:, :2] - other.project(points)[:, :2], axis=1).mean())


@dataclass(frozen=True)
class Answer:
    """What came out for a photo; no camera when it was refused."""

    status: PoseStatus
    seconds: float
    located: Located | None = None
    error: float = float("inf")


def answer(subject: Subject, file: Path, focal: float | None, given: Camera | None) -> Answer:
    """Locate one photo."""
    begin = time.perf_counter()
    try:
        located = subject.locator.locate(file, focal=focal)
    except InputError:
        return Answer(PoseStatus.REFUSED, time.perf_counter() - begin)
    error = float("inf") if given is None else pose_error(subject, located.camera, given)
    return Answer(located.verdict.status, time.perf_counter() - begin, located, error)


def pose_row(subject: Subject, *, known: bool) -> str:
    """Return the table's row of one scene, and print each photo."""
    answers = []
    for photo in subject.scene.test:
        focal = photo.camera.fx if known else None
        got = answer(subject, subject.files[photo.name], focal, photo.camera)
        told = None if got.located is None else got.located.verdict
        numbers = (
            "" if told is None else f" score {told.score:.2f}, pose uncertainty {told.pose_uncertainty:.3f},"
        )
        print(
            f"# {subject.name} {photo.name}: {got.error:.2f} px, {got.status.value},{numbers} {got.seconds:.1f} s"
        )
        answers.append(got)
    errors = np.array([got.error for got in answers])
    warned = np.array([got.status is not PoseStatus.GOOD for got in answers])
    wrong = errors > _WRONG
    seconds = [got.seconds for got in answers]
    return (
        f"| {subject.name} | {len(errors)} | {100 * (errors <= 1.5).mean():.0f} % | {100 * (~wrong).mean():.0f} % | "
        f"{np.median(errors):.2f} | {(wrong & ~warned).sum()} | {(~wrong & warned).sum()} | {np.median(seconds):.1f} | "
        f"{max(seconds):.1f} |"
    )


def light_row(subject: Subject) -> str:
    """Return the table's row of one scene with true lights: given and located, over the photos located
    without doubt.

    PSNR in dB between renders of the next test view under the predicted and under the true light.
    """
    rows, predictor = [], subject.predictor
    assert predictor is not None  # `main` asks for runs
    similarity = subject.decomposition.similarity
    photos = [photo for photo in subject.scene.test if photo.truth.environment is not None]
    for photo, other in zip(photos, [*photos[1:], photos[0]], strict=True):
        got = answer(subject, subject.files[photo.name], photo.camera.fx, photo.camera)
        if got.located is None or got.status is not PoseStatus.GOOD or photo.truth.environment is None:
            continue
        try:
            located = predictor.predict(got.located.pixels, got.located.pixel_camera)
        except InputError as error:
            print(f"# {subject.name} {photo.name}: no map of the located photo. {error}")
            continue
        given = predictor.predict(*load_pixels(photo))
        resolution = given.environment.resolution
        true = TrueLight.load(photo.truth.environment, photo.camera, similarity.center, resolution, CPU)
        view = other.camera.resized(160, 160)
        target = _shown(subject, true.environment, view)
        scores = [true.scores(prediction) for prediction in (given, located)]
        relit = [psnr(_shown(subject, p.environment, view), target) for p in (given, located)]
        rows.append([*(s[f"{n}_si_rmse"] for s in scores for n in ("diffuse", "matte", "mirror")), *relit])
    if not rows:
        return f"| {subject.name} | 0 | – | – | – | – |"
    mean = np.mean(rows, 0)
    spheres = ["/".join(f"{value:.3f}" for value in mean[part : part + 3]) for part in (0, 3)]
    return f"| {subject.name} | {len(rows)} | {spheres[0]} | {spheres[1]} | {mean[6]:.2f} | {mean[7]:.2f} |"


def _shown(subject: Subject, environment: Environment, view: Camera) -> torch.Tensor:
    """Return a displayed picture (H, W, 3) of the object under an environment."""
    image, _ = relight(subject.decomposition, environment, view)
    return srgb_encode(image.clamp(0, 1))


def wrong_files(
    subject: Subject, others: Mapping[str, Mapping[str, Path]], folder: Path
) -> Iterator[tuple[str, Path]]:
    """Yield kind and file of photos without the subject's object; others: photo files of scenes, by names."""
    for name, files in others.items():
        if name != subject.name:
            yield from ((name, file) for file in list(files.values())[:_OTHERS])
    known = ((photo.truth.environment, photo.camera) for photo in subject.scene.test)
    lit = [(light, camera) for light, camera in known if light is not None]
    for index, (light, camera) in enumerate(lit[:_BACKGROUNDS]):
        file = folder / "backgrounds" / f"{subject.name}_{index}.png"
        write_png(file, background(read_hdr(light), camera))
        yield "background", file
    random = np.random.default_rng(0)
    for index in range(_NOISE):
        coarse = random.uniform(size=(4 << index % 5, 4 << index % 5, 3))
        file = folder / "noise" / f"{index}.png"
        write_png(file, np.kron(coarse, np.ones((320 // len(coarse), 320 // len(coarse), 1))))
        yield "noise", file


def wrong_row(subject: Subject, others: Mapping[str, Mapping[str, Path]], folder: Path) -> str:
    """Return the table's row of photos without the object, and print those that are not refused."""
    counts = dict.fromkeys(PoseStatus, 0)
    for kind, file in wrong_files(subject, others, folder):
        got = answer(subject, file, None, None)
        counts[got.status] += 1
        if got.located is not None:
            print(
                f"# {subject.name} in {kind} {file.stem}: {got.status.value}, {got.located.verdict.score:.2f}"
            )
    cells = " | ".join(str(counts[status]) for status in PoseStatus)
    return f"| {subject.name} | {sum(counts.values())} | {cells} |"


_POSES = (
    "scene | photos | within 1.5 px | within 3 px | median px | wrong, silent | right, doubted | s | most s"
)
HEADS = {
    "poses": _POSES,
    "free": _POSES,
    "light": "scene | photos | spheres, given | spheres, located | relit, given | relit, located",
    "wrong": "object | photos without it | good | ambiguous | doubtful | refused",
}


def main(words: Sequence[str]) -> None:
    """Read the command line and print the tables."""
    parser = command_line(__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--runs", type=Path)
    parser.add_argument("--scenes", nargs="+", required=True)
    parser.add_argument("--others", nargs="*", default=[], help="more scenes for `wrong`; they need no run")
    parser.add_argument("--tables", nargs="+", choices=list(HEADS), default=list(HEADS))
    given = parser.parse_args(words)
    if given.runs is None and "light" in given.tables:
        parser.error("the table light needs --runs; choose others with --tables")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        subjects = [Subject.of(scene, given.data, given.runs, folder) for scene in given.scenes]
        photos = {subject.name: subject.files for subject in subjects}
        photos |= {name: dict(photo_files(name, scene_of(name, given.data), folder)) for name in given.others}
        rows: dict[str, Callable[[Subject], str]] = {
            "poses": lambda subject: pose_row(subject, known=True),
            "free": lambda subject: pose_row(subject, known=False),
            "light": light_row,
            "wrong": lambda subject: wrong_row(subject, photos, folder),
        }
        for table in given.tables:
            print(f"\n{table}\n| {HEADS[table]} |\n|{' --- |' * HEADS[table].count('|')} --- |")
            for subject in subjects:
                print(rows[table](subject), flush=True)
