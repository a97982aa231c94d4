"""Make scenes of published data sets: photos, masks, cameras and true lights in the forms that lightprobe reads.

    python -m benchmarks adapt owl dataset/OBJECT/test SCENE            Objects With Lighting (Ummenhofer et al. 2024)
    python -m benchmarks adapt orb data/blender_LDR/OBJECT_scene00N SCENE    Stanford-ORB (Kuang et al. 2023)

SCENE, a new folder, is then one for `lightprobe train` and `python -m benchmarks score`: transforms_{train,test}.json,
train/, test/, masks/ and light/, the true light of test photos as EXR in the scene's frame and a photo's exposure.
Nothing is downloaded. The training photos of a folder are taken to share one light (`light_group`).

owl, by the data set's README.md, scripts/create_dataset_files.py, scripts/evaluate.py and utils/equirectangular.py:
- inputs/{image_N.png,camera_N.txt,mask_N.png} are for training; gt_{image_N.png,camera_N.txt,mask_N.png} for testing,
  those without a mask left out, as the data set's own scores do. Its README calls training masks approximate.
- A camera file holds K (3 x 3), R (3 x 3), t and width, height, channels; a point X lies at K (R X + t), pixel centres
  at halves, the camera looks along +z with y down.
- gt_env_512_rotated_N.hdr has the axes of the cameras' world and lightprobe's layout: +z on top, +x in the middle, +y a
  quarter from the left. world_to_env*.txt belongs to the maps that are not rotated, which are not needed.
- A photo's value is (L 2^e)^(1 / 2.2), e from gt_exposure_N.txt, of radiance L in the unit and the colours of the maps
  (utils/color_calibration.py), which are not quite sRGB's. Lights are written times 2^e, photos as 16-bit PNG in sRGB,
  since a PNG that declares a gamma of 1 / 2.2 is read as sRGB.

orb, by the data set's README.md, orb/datasets/mymethod.py, orb/utils/env_map.py and issue 9 of its repository:
- transforms_{train,test,novel}.json are NeRF's: camera to world with OpenGL axes, `camera_angle_x`; photos lack their
  suffix, .png in blender_LDR, .exr in blender_HDR; the mask of DIR/N is DIR_mask/N.png.
- Frames of transforms_novel.json are test photos of the same object elsewhere, in ../`scene_name`, with cameras in this
  folder's frame. They become test photos, too, where that folder is there.
- ../../ground_truth/NAME/env_map/N.exr is the light of test photo N of folder NAME, in the camera's axes: a panorama
  whose middle looks where the camera does, its top along the camera's y (skylibs' `latlong`). It is turned into the
  world with the frame's camera. Photos whose map is missing or holds NaN stay without a true light.
- Lights are written in the unit that they have. Whether that is the photos' is not documented (the data set's scores
  are after a factor for each channel), so look at scores after a factor, not at raw ones.
"""

import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import command_line
from demo_scene.lights import reduce_area
from lightprobe.core.errors import ConfigError, InputError, shown
from lightprobe.core.files import atomic_folder, inside, named_file, read_json, write_json
from lightprobe.core.reading import LARGEST_PICTURE, LARGEST_TEXT, check_file, decode_text
from lightprobe.imaging import image_size, read_hdr, read_ldr, write_exr, write_png
from lightprobe.light import equirect
from lightprobe.scene.camera import Camera
from lightprobe.scene.frame import Split
from lightprobe.scene.transforms import frame_camera, frame_settings

_OWL_GAMMA = 2.2
_MOST_STOPS = 64  # of an exposure, up or down
_STRIP = 32  # rows of a map that are looked up at once


@dataclass(frozen=True)
class Shot:
    """A photo of a data set and what is known of it."""

    split: Split
    name: str  # in the scene, without suffix
    photo: Path
    mask: Path
    camera: Camera
    gamma: float | None = None  # power from the photo's values to linear light; None: as its file declares
    light: np.ndarray | None = None  # (H, 2H, 3) radiance in lightprobe's layout, the scene's frame


def owl(folder: Path) -> Iterator[Shot]:
    """Yield the photos of Objects With Lighting in one folder of an object; raise `InputError` for another layout."""
    inputs = folder / "inputs"
    for photo in sorted(inputs.glob("image_*.png")):
        camera, mask = _owl_files(photo)
        yield Shot(Split.TRAIN, photo.stem, photo, mask, owl_camera(camera), _OWL_GAMMA)
    for photo in sorted(folder.glob("gt_image_*.png")):
        camera, mask = _owl_files(photo)
        if not mask.is_file():
            print(f"{photo} is left out: {mask.name} does not exist.", file=sys.stderr)
            continue
        exposure = _numbers(file := _beside(photo, "exposure", ".txt"), 1)[0]
        if abs(exposure) > _MOST_STOPS:
            raise InputError(f"{file} holds an exposure of {exposure:.3g} stops; unpack the data set again.")
        light = _panorama(_beside(photo, "env_512_rotated", ".hdr"))
        light = None if light is None else light * np.float32(2**exposure)
        yield Shot(Split.TEST, photo.stem, photo, mask, owl_camera(camera), _OWL_GAMMA, light)


def _owl_files(photo: Path) -> tuple[Path, Path]:
    """Return the files of a photo's camera and mask."""
    return _beside(photo, "camera", ".txt"), _beside(photo, "mask", ".png")


def _beside(photo: Path, kind: str, suffix: str) -> Path:
    """Return the file of another kind that has the photo's number: gt_mask_0003.png for gt_image_0003.png."""
    return photo.with_name(photo.stem.replace("image", kind, 1) + suffix)


def owl_camera(path: Path) -> Camera:
    """Return the camera of a text file of Objects With Lighting; raise `InputError` where it holds none."""
    rows = _numbers(path, 24).reshape(8, 3)
    k, rotation, shift, (width, height, _) = rows[:3], rows[3:6], rows[6], rows[7]
    if not np.allclose(k, [[k[0, 0], 0, k[0, 2]], [0, k[1, 1], k[1, 2]], [0, 0, 1]]):
        raise InputError(f"{path} holds a camera with skewed pixels, which is not read; leave the photo out.")
    pose = np.eye(4)
    pose[:3, :3] = rotation.T * [1, -1, -1]  # to y up, looking along -z
    pose[:3, 3] = -rotation.T @ shift
    camera = Camera(pose, k[0, 0], k[1, 1], k[0, 2], k[1, 2], round(width), round(height))
    camera.check(str(path))
    return camera


def orb(folder: Path) -> Iterator[Shot]:
    """Yield the photos of Stanford-ORB in one folder of blender_LDR or blender_HDR; raise `InputError` else."""
    folder = folder.resolve()
    elsewhere = set()
    for part in ("train", "test", "novel"):
        file = folder / f"transforms_{part}.json"
        for settings in _orb_frames(file) if part != "novel" or file.is_file() else ():
            source = f"{file} ({shown(settings['file_path'])})"
            place = folder
            if part == "novel":
                place = named_file(folder.parent, str(settings.get("scene_name", "")))
            if place.is_dir():
                yield _orb_shot(part, place, settings, file, source)
            else:
                elsewhere.add(place.name)
    if elsewhere:
        names = ", ".join(sorted(elsewhere))
        print(f"Without test photos of {names}, which {folder.parent} does not hold.", file=sys.stderr)


def _orb_frames(file: Path) -> list[dict[str, Any]]:
    """Return the frames of a file, each with what the file says for all."""
    value = read_json(file)
    frames = value.get("frames") if isinstance(value, dict) else None
    if not isinstance(frames, list) or not all(
        isinstance(frame, dict) and isinstance(frame.get("file_path"), str) for frame in frames
    ):
        raise InputError(f"{file} has no list of 'frames' with a 'file_path' each; unpack it again.")
    common = {key: each for key, each in value.items() if key != "frames"}
    return [frame_settings(common, frame) for frame in frames]


def _orb_shot(part: str, place: Path, settings: dict[str, Any], file: Path, source: str) -> Shot:
    """Return the photo that a frame of `file` means; place: the folder that its path starts from."""
    written = settings["file_path"]
    found = [inside(place, written + end, source=file, follow_links=True) for end in (".png", ".exr")]
    photo = next((path for path in found if path.is_file()), None)
    if photo is None:
        raise InputError(f"{source} names a photo that is neither {found[0]} nor .exr; unpack it again.")
    above, _, number = written.rpartition("/")
    mask = inside(place, f"{above}_mask/{number}.png", source=file, follow_links=True)
    known = {key: settings.get(key) for key in ("camera_angle_x", "transform_matrix")}
    camera = frame_camera(known, source, *image_size(photo))
    if part == "train":
        return Shot(Split.TRAIN, f"train_{number}", photo, mask, camera)
    lights = place.parent.parent / "ground_truth" / place.name / "env_map"
    if not lights.is_dir():
        raise InputError(f"{lights} does not exist; unpack the data set's ground_truth beside its photos.")
    light_file = named_file(lights, number, ".exr")
    light = _panorama(light_file) if light_file.is_file() else None
    light = None if light is None else turned(light, camera.camera_to_world)
    name = f"{place.name if part == 'novel' else part}_{number}"
    return Shot(Split.TEST, name, photo, mask, camera, None, light)


def turned(panorama: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return a camera's panorama (H, 2H, 3) in lightprobe's layout and the world's axes, of the same size.

    panorama: its middle looks where the camera does, its top along the camera's y, its columns turn to the right.
    pose: (4, 4) camera to world, OpenGL axes.
    """
    right, up, back = pose[:3, :3].T
    axes = torch.from_numpy(np.stack([-back, -right, up], axis=1))  # ahead, left and up, in the world
    values, side = torch.from_numpy(panorama), 2 * len(panorama)  # four look-ups a texel keep small lamps
    strips = (equirect.directions(side).double() @ axes).reshape(-1, 3).split(_STRIP * 2 * side)
    fine = torch.cat([equirect.sample(values, strip) for strip in strips])
    return reduce_area(fine.numpy().reshape(side, 2 * side, 3), 2).astype(np.float32)


def _panorama(path: Path) -> np.ndarray | None:
    """Return a map (H, 2H, 3) float32 >= 0; None, and a line about it, where it holds NaN or infinity."""
    radiance = read_hdr(path)
    height, width, channels = radiance.shape
    if width != 2 * height or channels < 3:
        raise InputError(f"{path} is no map of a sphere, RGB and twice as wide as high; unpack it again.")
    if not np.isfinite(radiance[..., :3]).all():
        print(f"{path} holds NaN or infinity and is left out.", file=sys.stderr)
        return None
    return np.maximum(radiance[..., :3], 0).astype(np.float32)


def _numbers(path: Path, count: int) -> np.ndarray:
    """Return the `count` numbers of a text file, (count,) float64."""
    check_file(path, LARGEST_TEXT)
    try:
        found = np.array(decode_text(path.read_bytes()).split(), float)
    except (OSError, ValueError):  # and what is no text
        found = np.array([])
    if len(found) != count or not np.isfinite(found).all():
        raise InputError(f"{path} must hold {count} finite numbers and nothing else; unpack it again.")
    return found


LAYOUTS = {"owl": owl, "orb": orb}


def adapt(layout: str, folder: Path, scene: Path) -> dict[Split, list[dict[str, Any]]]:
    """Write the scene of a data set's `folder` and return its frames.

    Raises `InputError` for a folder that is damaged or of another layout, `ConfigError` where `scene` is there already.
    """
    if scene.exists() or scene.is_symlink():
        raise ConfigError(f"{scene} is there already; name a new folder.")
    frames: dict[Split, list[dict[str, Any]]] = {Split.TRAIN: [], Split.TEST: []}
    with atomic_folder(scene) as temporary:
        for shot in LAYOUTS[layout](folder):
            frames[shot.split].append(_written(shot, temporary))
        if not frames[Split.TRAIN]:
            raise InputError(f"{folder} holds no training photos in the layout {layout}; see adapt --help.")
        for split, found in frames.items():
            if found:
                write_json(temporary / f"transforms_{split.value}.json", {"frames": found})
    return frames


def _written(shot: Shot, scene: Path) -> dict[str, Any]:
    """Write a photo with its mask and light into a scene and return its frame."""
    suffix = shot.photo.suffix if shot.gamma is None else ".png"
    photo, mask = (f"{folder}{shot.split.value}/{shot.name}" for folder in ("", "masks/"))
    if (scene / f"{mask}.png").exists():
        raise InputError(f"{shot.photo} is named twice, or two photos would be {photo}{suffix}; keep one.")
    for folder in (photo, mask):
        (scene / folder).parent.mkdir(parents=True, exist_ok=True)
    if shot.gamma is None:
        _copy(shot.photo, scene / f"{photo}{suffix}")
    else:
        values, _ = read_ldr(shot.photo, srgb=False)
        write_png(scene / f"{photo}.png", values**shot.gamma, bits=16)
    _copy(shot.mask, scene / f"{mask}.png")
    c = shot.camera
    frame: dict[str, Any] = {"file_path": f"./{photo}{suffix}", "mask_path": f"./{mask}.png"}
    frame |= {"fl_x": c.fx, "fl_y": c.fy, "cx": c.cx, "cy": c.cy, "w": c.width, "h": c.height}
    frame |= {"transform_matrix": c.camera_to_world.tolist()}
    if shot.split is Split.TRAIN:
        frame["light_group"] = "training"
    if shot.light is not None:
        write_exr(scene / "light" / f"{shot.name}.exr", shot.light)
        frame["env_path"] = f"./light/{shot.name}.exr"
    return frame


def _copy(source: Path, target: Path) -> None:
    check_file(source, LARGEST_PICTURE)
    try:
        shutil.copyfile(source, target)
    except PermissionError as error:
        raise InputError(f"{source} cannot be read: {error.strerror}.") from error


def main(words: Sequence[str]) -> None:
    """Write the scene that the command line asks for."""
    parser = command_line(__doc__)
    parser.add_argument("layout", choices=LAYOUTS)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("scene", type=Path, metavar="SCENE")
    given = parser.parse_args(words)
    frames = adapt(given.layout, given.folder, given.scene)
    train, test = frames[Split.TRAIN], frames[Split.TEST]
    lit = sum("env_path" in frame for frame in test)
    print(f"{given.scene}: {len(train)} training and {len(test)} test photos, {lit} with their true light")
