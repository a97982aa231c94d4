"""Preparing plain photos as a scene, alone or as the first step of a run."""

import warnings
from pathlib import Path

from lightprobe.core.errors import LightprobeWarning
from lightprobe.core.files import atomic_folder, checksum
from lightprobe.core.run import RunFolder
from lightprobe.imaging import extract_frames
from lightprobe.preparation import HIDDEN, Prepared, PrepareOptions, check_output, prepare
from lightprobe.runs.progress import OnProgress, silent
from lightprobe.scene.plain_photos import VIDEO_FRAMES, only_video

_NAMED = 16  # digits of a video's checksum that name the folder of its frames
SCENE = "scene"  # the folder in a run that holds what was made of plain photos


def prepare_scene(
    photos: Path | str,
    output: Path | str,
    options: PrepareOptions | None = None,
    *,
    on_progress: OnProgress = silent,
) -> Prepared:
    """Make a scene folder of plain photos or a video: cameras, masks, upright frame, prepare.json, contact.png.

    photos: a folder, or a video, of which sharp, well-spread frames are taken.
    The same call goes on where an interrupted one stopped, and with masks that were corrected in
    `output`/masks. Warns of what may be wrong. Raises `InputError` for photos from which no scene can be
    made, `ConfigError` for options that cannot be used or without the libraries of lightprobe[photos].
    """
    video = only_video(Path(photos))
    folder = Path(photos) if video is None else _frames_of(video, Path(output))
    prepared = prepare(folder, Path(output), options or PrepareOptions(), on_progress)
    for sentence in prepared.warnings:
        warnings.warn(sentence, LightprobeWarning, stacklevel=2)
    return prepared


def _frames_of(video: Path, output: Path) -> Path:
    """Return the folder with a video's frames, hidden in the scene, after writing it unless it is there."""
    check_output(output)  # before anything lies in it
    folder = output / HIDDEN / f"frames-{checksum(video)[:_NAMED]}"
    if not folder.is_dir():
        with atomic_folder(folder) as temporary:  # once it is there, it is whole
            extract_frames(video, temporary, VIDEO_FRAMES)
    return folder


def prepared_in(run: RunFolder, photos: Path, on_progress: OnProgress) -> Path:
    """Return the scene that a run holds of plain photos, after making it or going on with it."""
    return prepare_scene(photos, run.path / SCENE, on_progress=on_progress).folder
