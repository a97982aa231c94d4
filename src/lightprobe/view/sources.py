"""What the page shows: run folders, and scene folders that `lightprobe prepare` made or plain photos."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import inside
from lightprobe.core.run import RunFolder
from lightprobe.scene.camera import Camera
from lightprobe.scene.plain_photos import is_plain
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

    def files(self, photo: RunPhoto) -> tuple[Path, Path | None]:
        """Return the files of a photo and of its own mask, if it has one.

        Raises `InputError` when a file is gone or lies outside of the run's scene.
        """
        record = self.run.scene()
        named = record["photos"][photo.split][photo.name]

        def file(kind: str) -> Path:
            return inside(Path(record["root"]), named[kind], source=self.run.scene_file)

        return file("image"), file("mask") if "mask" in named else None


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
