"""Measure what `lightprobe prepare` makes of plain photos whose cameras and masks are known: tables in
Markdown.

    python -m benchmarks prepare DATA --work WORK [--scenes cape liberty turntable] [--hint PHOTO]

DATA/nerd/SCENE holds photos of real scenes with `poses_bounds.npy` and masks; the turntable is rendered by
`tools/turntable_photos.py`. Only the photos are given to `prepare`, and the mask of one photo as hint: the
photo in the middle of the list, which may be a close-up, or the one that `--hint` names. Cameras are compared
after the similarity that fits their positions best; distance is that of a camera from the object. What is in
WORK already is not made again, so that times are those of the first run.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import command_line
from lightprobe.core.files import read_json
from lightprobe.imaging import read_mask, shrink_area
from lightprobe.preparation import PrepareOptions, prepare
from lightprobe.scene.camera import Camera
from lightprobe.scene.frame import Problems
from lightprobe.scene.loading import read_folder
from turntable_photos import render, write

_SIDE = 400  # pixels of the longer side of the masks that are compared
_HEAD = (
    "| scene | registered | rotation, median (deg) | position, median (%) | mask IoU, mean | worst | doubtful masks "
    "| seconds | kept | trap |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- | --- |"
)


@dataclass(frozen=True)
class Truth:
    """Known cameras and masks of photos, by name."""

    photos: Path
    cameras: dict[str, Camera]
    masks: dict[str, Path]


def real_scene(folder: Path) -> Truth:
    """Return what is known of a scene in NeRD's layout."""
    reading = read_folder(folder, Problems())
    photos = [photo for _, photo in reading.all_photos()]
    masks = {photo.name: photo.mask_path for photo in photos if photo.mask_path is not None}
    return Truth(folder / "images", {photo.name: photo.camera for photo in photos}, masks)


def turntable(folder: Path) -> Truth:
    """Return the rendered turntable, made where it is not there yet."""
    if not (folder / "true_cameras.json").is_file():
        write(render(40, 640), folder)
    cameras = {n: Camera.from_json(v, source=n) for n, v in read_json(folder / "true_cameras.json").items()}
    return Truth(
        folder / "images", cameras, {name: folder / "true_masks" / f"{name}.png" for name in cameras}
    )


def compare(found: dict[str, Camera], true: dict[str, Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (K,) of rotation, degrees, and position, percent of the distance, after the best
    similarity.
    """
    names = sorted(set(found) & set(true))
    a = np.stack([found[name].position for name in names])
    b = np.stack([true[name].position for name in names])
    turn, scale, shift = similarity(a, b)
    axes = np.stack([turn @ found[name].camera_to_world[:3, :3] for name in names])
    wanted = np.stack([true[name].camera_to_world[:3, :3] for name in names])
    cosine = (np.einsum("kij,kij->k", axes, wanted) - 1) / 2
    rays = -wanted[:, :, 2]
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    middle = np.linalg.lstsq(across.sum(0), (across @ b[:, :, None]).sum(0)[:, 0], rcond=None)[0]
    distance = np.linalg.norm(b - middle, axis=1)
    off = np.linalg.norm(scale * a @ turn.T + shift - b, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))), 100 * off / distance


def similarity(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Return rotation (3, 3), scale, shift (3,) from points a (K, 3) to b, trimmed (Umeyama 1991)."""
    chosen = np.arange(len(a))
    for _ in range(5):
        x, y = a[chosen], b[chosen]
        mx, my = x.mean(0), y.mean(0)
        u, s, vt = np.linalg.svd((y - my).T @ (x - mx) / len(x))
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        turn = u @ sign @ vt
        scale = float((s * np.diag(sign)).sum() / ((x - mx) ** 2).sum(1).mean())
        shift = my - scale * turn @ mx
        off = np.linalg.norm(scale * a @ turn.T + shift - b, axis=1)
        chosen = np.flatnonzero(off <= max(3 * np.median(off), 1e-9))
    return turn, scale, shift


def mask_overlaps(scene: Path, true: dict[str, Path]) -> np.ndarray:
    """Return the IoU (K,) of written and true masks, compared at one size."""
    found = []
    for frame in read_json(scene / "transforms.json")["frames"]:
        name = Path(frame["mask_path"]).stem
        mine, wanted = (
            shrink_area(read_mask(p), _SIDE) >= 0.5 for p in (scene / frame["mask_path"], true[name])
        )
        found.append((mine & wanted).sum() / max((mine | wanted).sum(), 1))
    return np.array(found)


def written_cameras(scene: Path) -> dict[str, Camera]:
    """Return the cameras of a scene that `prepare` wrote, by name."""
    return {photo.name: photo.camera for _, photo in read_folder(scene, Problems()).all_photos()}


def measure(name: str, truth: Truth, work: Path, hinted: bool, chosen: str | None = None) -> str:
    """Prepare one scene and return its row; chosen: the hint's photo, by default the one in the middle."""
    marked = chosen or sorted(truth.masks)[len(truth.masks) // 2]
    photo = next(path for path in sorted(truth.photos.iterdir()) if path.stem == marked)
    hint = f"{photo.name}={truth.masks[marked]}" if hinted else None
    scene, start = work / f"{name}-{'hint' if hinted else 'bare'}", time.monotonic()
    report = prepare(truth.photos, scene, PrepareOptions(hint=hint)).report
    seconds = time.monotonic() - start
    turned, moved = compare(written_cameras(scene), truth.cameras)
    overlaps = mask_overlaps(scene, truth.masks)
    return (
        f"| {name}, {'one mask' if hinted else 'bare'} | {report['registered']} of {report['total']} | "
        f"{np.median(turned):.2f} | {np.median(moved):.2f} | {overlaps.mean():.3f} | {overlaps.min():.3f} | "
        f"{len(report['doubtful_masks'])} | {seconds:.0f} | {report['kept']['reconstruction']} | "
        f"{'named' if report['trap'] else '-'} |"
    )


def main(words: Sequence[str]) -> None:
    """Measure the scenes that the command line names, and print the table."""
    parser = command_line(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument(
        "--work", type=Path, required=True, help="folder for scenes and the rendered turntable"
    )
    parser.add_argument("--scenes", nargs="*", default=["cape", "liberty", "turntable"])
    hinted = parser.add_mutually_exclusive_group()
    hinted.add_argument("--bare", action="store_true", help="without the hint")
    hinted.add_argument("--hint", metavar="PHOTO", help="the photo whose mask is the hint, for one scene")
    given = parser.parse_args(words)
    if given.hint is not None and len(given.scenes) != 1:
        parser.error("--hint names a photo of one scene; give that scene with --scenes.")
    print(_HEAD, flush=True)
    for name in given.scenes:
        truth = (
            turntable(given.work / "photos")
            if name == "turntable"
            else real_scene(given.data / "nerd" / name)
        )
        if given.hint is not None and given.hint not in truth.masks:
            parser.error(f"--hint: {name} has no photo {given.hint} with a mask.")
        print(measure(name, truth, given.work, not given.bare, given.hint), flush=True)
