"""Frames of videos that the tests encode themselves."""

from fractions import Fraction

import av
import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import read_ldr, srgb_decode
from lightprobe.imaging.video import choose_frames, extract_frames, frames, is_video, measure_frames
from tests.imaging.videos import pan, write_video


def test_the_sharp_frames_are_chosen_all_along(tmp_path):
    """Every third frame is sharp: of each stretch of three, that one."""
    sharp = set(range(1, 30, 3))
    path = write_video(tmp_path / "a.mp4", pan(30, blurred=set(range(30)) - sharp))
    choice = choose_frames(measure_frames(path), 10)
    assert [frame.index for frame in choice.frames] == sorted(sharp)
    assert (choice.total, choice.blurred, choice.alike) == (30, 0, 0)


def test_a_stretch_without_a_sharp_frame_gives_none(tmp_path):
    path = write_video(tmp_path / "a.mp4", pan(30, blurred=range(9, 15)))
    choice = choose_frames(measure_frames(path), 10)
    assert choice.blurred == 2
    assert not {frame.index for frame in choice.frames} & set(range(9, 15))


def test_pictures_of_the_same_are_taken_once(tmp_path):
    path = write_video(tmp_path / "a.mp4", pan(30, still=range(10, 25)))
    choice = choose_frames(measure_frames(path), 15)
    during = [frame for frame in choice.frames if 10 <= frame.index < 25]
    assert len(during) <= 1
    assert choice.alike >= 6


def test_frames_become_files_at_once(tmp_path):
    path = write_video(tmp_path / "a.mp4", pan(12))
    choice = extract_frames(path, tmp_path / "photos", 4)
    files = sorted((tmp_path / "photos").iterdir())
    assert [file.name for file in files] == [f"frame_{frame.index:06d}.jpg" for frame in choice.frames]
    assert len(files) == 4
    expected = pan(12)[choice.frames[1].index]
    assert np.abs(np.asarray(Image.open(files[1])).astype(int) - expected).mean() < 12


def test_every_second_frame_and_its_colours(tmp_path):
    flat = np.broadcast_to(np.array([200, 90, 40], np.uint8), (48, 64, 3))
    path = write_video(tmp_path / "a.mp4", [flat] * 7)
    found = list(frames(path, 2))
    assert [frame.index for frame in found] == [0, 2, 4, 6]
    assert [frame.seconds for frame in found] == pytest.approx([0, 0.2, 0.4, 0.6])
    assert found[0].color.dtype == np.float32
    np.testing.assert_allclose(found[1].color[24, 32], srgb_decode(np.array([200, 90, 40]) / 255), atol=0.02)


@pytest.mark.parametrize(
    ("turn", "corner"), [((0, 1, -1, 0), (0, -1)), ((-1, 0, 0, -1), (-1, -1)), ((0, -1, 1, 0), (-1, 0))]
)
def test_a_phone_held_upright(tmp_path, turn, corner):
    """The matrix of the track (ISO 14496-12, tkhd) turns what the sensor recorded: clockwise is (0, 1, -1,
    0).
    """
    picture = np.full((48, 96, 3), 20, np.uint8)
    picture[:24, :24] = 240
    path = write_video(tmp_path / "a.mp4", [picture] * 3)
    data = path.read_bytes()
    plain = b"".join(value.to_bytes(4, "big") for value in (65536, 0, 0, 0, 65536, 0, 0, 0, 1 << 30))
    a, b, c, d = ((value * 65536).to_bytes(4, "big", signed=True) for value in turn)
    at = data.index(plain, data.index(b"tkhd"))
    path.write_bytes(data[:at] + a + b + bytes(4) + c + d + data[at + 20 :])
    color = next(frames(path)).color
    assert color.shape[:2] == ((96, 48) if turn[0] == 0 else (48, 96))
    bright = [(i, j) for i in (0, -1) for j in (0, -1) if color[i, j].min() > 0.5]
    assert bright == [corner]


def test_ten_bits_of_hlg(tmp_path):
    """Reference white of HLG is 75 % of the code (BT.2408): 1.0."""
    grey = np.full((64, 96, 3), round(0.75 * 65535), np.uint16)
    settings = {"color_primaries": 9, "color_trc": 18, "colorspace": 9}
    path = write_video(tmp_path / "a.mkv", [grey] * 3, codec="ffv1", pixels="yuv420p10le", **settings)
    np.testing.assert_allclose(next(frames(path)).color, 1, atol=0.03)


def test_pixels_that_are_not_square(tmp_path):
    path = write_video(tmp_path / "a.mp4", pan(3), sample_aspect_ratio=Fraction(4, 3))
    assert next(frames(path)).color.shape == (pan(1)[0].shape[0], round(160 * 4 / 3), 3)


def test_one_picture_is_refused(tmp_path):
    for count in (1, 8):
        path = write_video(tmp_path / f"{count}.mp4", pan(1) * count)
        with pytest.raises(
            InputError, match=rf"one and the same picture in all of its {count} frames.*walking"
        ):
            extract_frames(path, tmp_path / "photos", 5)
    assert not (tmp_path / "photos").exists()


def test_what_is_no_video_is_one_sentence(tmp_path):
    (tmp_path / "text.mp4").write_text("#EXTM3U\nhttp://127.0.0.1/a.ts\n")
    with pytest.raises(InputError, match="is not a video"):
        next(frames(tmp_path / "text.mp4"))
    with pytest.raises(InputError, match="does not exist"):
        next(frames(tmp_path / "none.mp4"))
    data = write_video(tmp_path / "a.mp4", pan(6)).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"cut\.mp4 .*damaged or cut short"):
        next(frames(tmp_path / "cut.mp4"))
    assert is_video(tmp_path / "a.mp4")
    Image.fromarray(pan(1)[0]).save(tmp_path / "a.jpg")
    Image.fromarray(pan(1)[0]).save(tmp_path / "a.webp")
    assert not any(is_video(tmp_path / name) for name in ("a.jpg", "a.webp", "text.mp4", "none.mp4"))
    with pytest.raises(InputError, match="is a video where a photo is meant"):
        read_ldr(tmp_path / "a.mp4")


def test_notes_that_are_no_text_do_not_matter(tmp_path):
    path = write_video(tmp_path / "a.mp4", pan(3))
    content = path.read_bytes()
    path.write_bytes(content[:8] + b"\x9f\xbc" + content[10:])  # the brand, which FFmpeg takes for a note
    assert len(list(frames(path))) == 3


def test_a_coding_that_nobody_knows_is_one_sentence(tmp_path):
    path = write_video(tmp_path / "a.avi", pan(3))
    path.write_bytes(path.read_bytes().replace(b"FMP4", b"\1\2\3\4"))
    with pytest.raises(InputError, match=r"a\.avi is coded in a way that is not read"):
        list(frames(path))


def test_sound_alone(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as video:
        stream = video.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 4096), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        video.mux(stream.encode(frame))
        video.mux(stream.encode())
    with pytest.raises(InputError, match="holds no pictures"):
        next(frames(tmp_path / "a.mp4"))


def test_without_the_library(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.mp4", pan(2))
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(InputError, match=r"without the library av; install .*lightprobe\[photos\]"):
        next(frames(path))


@pytest.mark.filterwarnings("ignore:.*is damaged behind its frame")
def test_a_broken_end_leaves_the_frames_before_it(tmp_path):
    path = write_video(tmp_path / "a.avi", pan(20))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert 5 <= len(list(frames(path))) < 20


@pytest.mark.parametrize("suffix", ["mp4", "mov", "m4v", "mkv", "avi", "ts", "mpg", "3gp"])
def test_every_container(tmp_path, suffix):
    codec = "mpeg2video" if suffix in ("ts", "mpg") else "mpeg4"
    path = write_video(tmp_path / f"a.{suffix}", pan(6), codec=codec, rate=25)
    assert is_video(path)
    assert len(list(frames(path))) == 6
