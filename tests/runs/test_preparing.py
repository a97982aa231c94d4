"""A video in place of photos: its frames are taken once, and prepared as photos are."""

from pathlib import Path

import av
import numpy as np
import pytest

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.runs import preparing
from lightprobe.runs.preparing import prepare_scene


@pytest.fixture
def prepared_folders(monkeypatch):
    """What the preparation is asked for, in its place."""
    asked = []

    class Nothing:
        warnings = ("doubtful",)

    def record(folder, output, options, on_progress):
        asked.append(folder)
        return Nothing()

    monkeypatch.setattr(preparing, "prepare", record)
    return asked


def write_video(path: Path, frames: int) -> None:
    random = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.height, stream.width, stream.pix_fmt, stream.bit_rate = 96, 128, "yuv420p", 4_000_000
        for _ in range(frames):
            noise = np.kron(random.integers(0, 256, (12, 16, 3)), np.ones((8, 8, 1))).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(noise, format="rgb24")))
        container.mux(stream.encode())


def test_a_video_s_frames_are_taken_once(tmp_path, prepared_folders):
    video, scene = tmp_path / "photos" / "cup.mp4", tmp_path / "scene"
    video.parent.mkdir()
    write_video(video, 8)
    for photos in (video, video.parent):  # a folder with nothing but the video
        with pytest.warns(UserWarning, match="doubtful"):
            prepare_scene(photos, scene)
    first, second = prepared_folders
    assert first == second
    frames = sorted(first.iterdir())
    assert len(frames) == 8
    assert scene in first.parents
    write_video(video, 5)
    with pytest.warns(UserWarning, match="doubtful"):
        prepare_scene(video, scene)
    assert prepared_folders[2] != first


def test_frames_are_there_all_or_none(tmp_path, prepared_folders, monkeypatch):
    """So that a run that is killed while they are written writes them again."""
    extract, seen = preparing.extract_frames, []

    def watched(video, folder, count):
        extract(video, folder, count)
        seen.extend(
            path.name for path in (tmp_path / "scene" / ".prepare").iterdir() if path.name[:6] == "frames"
        )

    monkeypatch.setattr(preparing, "extract_frames", watched)
    write_video(tmp_path / "cup.mp4", 8)
    with pytest.warns(UserWarning, match="doubtful"):
        prepare_scene(tmp_path / "cup.mp4", tmp_path / "scene")
    assert seen == []
    assert len(list(prepared_folders[0].iterdir())) == 8


def test_a_video_s_frames_do_not_go_where_something_else_is(tmp_path, prepared_folders):
    """Masks and images of the scene would take the place of the user's own."""
    video, other = tmp_path / "cup.mp4", tmp_path / "other"
    write_video(video, 8)
    (other / "images").mkdir(parents=True)
    (other / "images" / "mine.jpg").write_bytes(b"mine")
    with pytest.raises(ConfigError, match="was not made by prepare"):
        prepare_scene(video, other)
    assert [path.relative_to(other).as_posix() for path in other.rglob("*")] == ["images", "images/mine.jpg"]
    (other / ".prepare" / "frames").mkdir(parents=True)  # as an earlier version left it there
    with pytest.raises(ConfigError, match="was not made by prepare"):
        prepare_scene(video, other)


def test_a_video_of_one_picture_is_refused(tmp_path, prepared_folders):
    write_video(tmp_path / "cup.mp4", 1)
    with pytest.raises(InputError, match="one and the same picture"):
        prepare_scene(tmp_path / "cup.mp4", tmp_path / "scene")
    assert prepared_folders == []
    assert not list(tmp_path.glob("scene/.prepare/frames*"))
