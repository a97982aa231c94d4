"""What the page shows: run folders, and scene folders that `lightprobe prepare` made or plain photos."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import inside
from lightprobe.core.run import RunFolder
from lightprobe.scene.camera import Camera
from lightprobe.scene.plain_inspection import is_plain
from lightprobe.scene.record import SPLITS, read_record
from lightprobe.view.scenes import PREPARED, SceneSource


@dataclass(frozen=True)
class RunPhoto:
    """A photo of a run's scene."""

    name: str
    split: str
    camera: Camera  # input frame


@dataclass(frozen=True)
class RunSource:
    """A run folder that the page shows."""

    run: RunFolder

    @property
    def mesh_file(self) -> Path:
        """The object as GLB, which Phase I writes."""
        return self.run.mesh_folder / "object.glb"

    @property
    def begun(self) -> str:
        """Which training of the run this is: `--restart` begins another one, perhaps of other photos."""
        scene = self.run.scene_file
        return str(scene.stat().st_mtime_ns) if scene.is_file() else ""

    def photos(self) -> list[RunPhoto]:
        """Return the photos of its scene, those it learnt from first; none before the scene is read."""
        if not self.run.scene_file.is_file():
            return []
        cameras = read_record(self.run).cameras
        return [RunPhoto(name, split, camera) for split in SPLITS for name, camera in cameras[split].items()]

    def image_file(self, photo: RunPhoto) -> Path:
        """Return the file of a photo; raise `InputError` when it is gone or lies outside of the run's scene."""
        return self._file(photo, "image")

    def mask_file(self, photo: RunPhoto) -> Path | None:
        """Return the file of a photo's mask, None where it has none of its own; errors as `image_file`."""
        has_one = "mask" in self.run.scene()["photos"][photo.split][photo.name]
        return self._file(photo, "mask") if has_one else None

    def _file(self, photo: RunPhoto, kind: str) -> Path:
        record = self.run.scene()
        name = record["photos"][photo.split][photo.name][kind]
        return inside(Path(record["root"]), name, source=self.run.scene_file)


@dataclass(frozen=True)
class Sources:
    """Everything that was named on the command line."""

    runs: tuple[RunSource, ...]
    scenes: tuple[SceneSource, ...]

    @staticmethod
    def of(folders: Sequence[Path]) -> "Sources":
        """Return runs, and the scenes named or made for a run.

        Raises `ConfigError` without a folder, `InputError` for one that is none of these.
        """
        if not folders:
            raise ConfigError("No run is named: lightprobe view RUN.")
        runs: list[RunSource] = []
        scenes: list[SceneSource] = []
        for folder in folders:
            if (folder / "config.json").is_file():
                runs.append(RunSource(RunFolder.open(folder)))
                scenes += _scene_of(runs[-1].run)
            else:
                scenes.append(_scene(folder))
        return Sources(tuple(runs), tuple({scene.folder.resolve(): scene for scene in scenes}.values()))


def _scene(folder: Path) -> SceneSource:
    """Return a folder as a scene; raise `InputError` when it is none that can be worked on."""
    if (folder / PREPARED).is_file():
        return SceneSource(folder, True)
    if folder.is_dir() and is_plain(folder):
        return SceneSource(folder, False)
    raise InputError(
        f"{folder} is neither a run (config.json), nor a scene that `lightprobe prepare` made (prepare.json), nor a "
        "folder of photos; make a run with: lightprobe train SCENE -o RUN"
    )


def _scene_of(run: RunFolder) -> list[SceneSource]:
    """Return the prepared scene that a run learnt from, if it did from one and it is still there."""
    folders = [run.path / "scene"]
    if run.scene_file.is_file():
        folders.append(Path(run.scene()["root"]))
    return [SceneSource(folder, True) for folder in folders if (folder / PREPARED).is_file()][:1]
