"""predict on photos of one light, on opaque photos with their background, and on a video."""

import json

import av
import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import read_hdr, read_ldr, srgb_encode, write_exr, write_png
from tests.cli.commands import fails, succeed

_EXIF_FOLDER, _EXPOSURE_TIME, _F_NUMBER, _ISO = 0x8769, 0x829A, 0x829D, 0x8827


@pytest.fixture(scope="module")
def opaque(trained, tmp_path_factory):
    """Test photos over a grey wall, with masks in a folder of their own, and their cameras."""
    scene, folder = trained[0], tmp_path_factory.mktemp("opaque")
    for path in sorted((scene / "test").glob("*.png"))[:2]:
        color, alpha = read_ldr(path)
        write_png(folder / "masks" / path.name, np.repeat(alpha[..., None], 3, 2), srgb=False)
        write_png(folder / path.name, color * alpha[..., None] + 0.3 * (1 - alpha[..., None]))
    return sorted(folder.glob("*.png")), folder / "masks", scene / "transforms_test.json"


def given(opaque):
    return ["--camera", opaque[2], "--mask", opaque[1]]


@pytest.mark.slow
def test_photos_of_one_light_give_one_map(trained, opaque, tmp_path, capsys):
    images, _, _ = opaque
    out = tmp_path / "light.exr"
    succeed("predict", trained[1].path, *images, *given(opaque), "--one-light", "-o", out)
    printed = capsys.readouterr().out
    assert "Exposures relative to the first, found with the light" in printed
    assert f"{images[1].name} " in printed
    both = read_hdr(out)
    succeed("predict", trained[1].path, images[0], *given(opaque), "-o", tmp_path / "alone.exr")
    assert both.shape == read_hdr(tmp_path / "alone.exr").shape
    assert not np.allclose(both, read_hdr(tmp_path / "alone.exr"), rtol=0.05)


def test_a_photo_that_is_given_twice_is_refused_before_any_work(trained, opaque, tmp_path, capsys):
    image, out = opaque[0][0], tmp_path / "light.exr"
    arguments = ["predict", trained[1].path, image, image, *given(opaque), "--one-light", "-o", out]
    fails(arguments, capsys, ["same name"])
    assert not out.exists()


@pytest.mark.slow
def test_exposures_come_from_exif_where_all_photos_tell_them(trained, opaque, tmp_path, capsys):
    images = []
    for path, seconds in zip(opaque[0], (0.01, 0.02), strict=True):
        exif = Image.Exif()
        exif.get_ifd(_EXIF_FOLDER).update({_EXPOSURE_TIME: seconds, _F_NUMBER: 4.0, _ISO: 100})
        images.append(tmp_path / f"{path.stem}.jpg")
        Image.open(path).save(images[-1], exif=exif, quality=95)
    succeed("predict", trained[1].path, *images, *given(opaque), "--one-light", "-o", tmp_path / "light.exr")
    assert f"from EXIF: {images[0].name} 1.00, {images[1].name} 2.00" in capsys.readouterr().out


@pytest.mark.slow
def test_a_photo_that_cannot_serve_is_left_out_and_named(trained, opaque, tmp_path, capsys):
    """One of which the mask is empty, and one that is white all over."""
    (first, second), masks, cameras = opaque
    empty, white, light, plain = (tmp_path / name for name in ("masks", first.name, "light.exr", "plain.exr"))
    for mask in masks.iterdir():
        color = read_ldr(mask, srgb=False)[0]
        write_png(empty / mask.name, color * (mask.stem != second.stem), srgb=False)
    predict = ["predict", trained[1].path, "--camera", cameras, "--one-light", "-o"]
    fails([*predict, light, first, second, "--mask", empty], capsys, [f"{second} is not in the map. "])
    assert light.is_file()
    write_png(white, np.ones_like(read_ldr(first)[0]))
    told = f"{white} is not in the map. 100 % of the object's values are clipped"
    fails([*predict, light, white, second, "--mask", masks], capsys, [told])
    succeed(*predict, plain, second, "--mask", masks)
    np.testing.assert_array_equal(read_hdr(light), read_hdr(plain))


@pytest.mark.slow
def test_the_background_is_used_unless_told_otherwise(trained, opaque, tmp_path, capsys):
    predict = ["predict", trained[1].path, opaque[0][0], *given(opaque), "-o", tmp_path / "light.exr"]
    for more, used in (([], True), (["--no-background"], False)):
        succeed(*predict, *more)
        assert ("; background " in capsys.readouterr().out) is used


@pytest.mark.long
def test_a_video_gives_a_map_for_every_few_frames_or_one_for_all(trained, opaque, tmp_path, capsys):
    clip = tmp_path / "clip.mp4"
    write_clip(clip, opaque[0][0], frames=7)
    mask = opaque[1] / opaque[0][0].name
    # One camera for the whole clip: that of a tripod.
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps(trained[1].scene()["photos"]["test"][opaque[0][0].stem]["camera"]))
    common = ["--camera", camera, "--mask", mask]
    out = tmp_path / "lights"
    succeed("predict", trained[1].path, clip, *common, "--every", "3", "-o", out)
    assert sorted(path.name for path in out.glob("*.exr")) == [
        f"frame_00000{index}.exr" for index in (0, 3, 6)
    ]
    assert "3 maps in" in capsys.readouterr().out
    succeed(
        "predict", trained[1].path, clip, *common, "--every", "3", "--one-light", "-o", tmp_path / "one.exr"
    )
    assert read_hdr(tmp_path / "one.exr").shape == read_hdr(out / "frame_000000.exr").shape
    frames = ["frame_000000.png", "frame_000003.png", "frame_000006.png"]
    assert sorted(path.name for path in (tmp_path / "one" / "frames").iterdir()) == frames
    assert not (tmp_path / "frames").exists()  # which may be somebody's own
    for path in (out / "frames").iterdir():
        path.unlink()
    succeed("predict", trained[1].path, clip, *common, "--every", "3", "--one-light", "-o", out)
    assert sorted(path.name for path in (out / "frames").iterdir()) == frames


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["{photo}"], "is a video; predict from it alone"),
        (["--one-light", "-o", "one.png"], "one.png"),
        (["--every", "0"], "--every must be at least 1"),
        (["-o", "one.exr"], "need a folder"),
    ],
)
def test_what_cannot_be_predicted_from_a_video_is_refused(
    trained, opaque, tmp_path, monkeypatch, capsys, more, words
):
    monkeypatch.chdir(tmp_path)
    write_clip(tmp_path / "clip.mp4", opaque[0][0], frames=2)
    more = [word.format(photo=opaque[0][0]) for word in more]
    fails(["predict", trained[1].path, "clip.mp4", *more], capsys, [words])
    assert [path.name for path in tmp_path.iterdir()] == ["clip.mp4"]


def test_frames_of_photos_are_not_asked_for(trained, opaque, capsys):
    fails(["predict", trained[1].path, opaque[0][0], "--every", "2"], capsys, ["--every is about a video's"])


def write_clip(path, picture, frames):
    """Write a clip of one picture that slowly grows brighter."""
    color = read_ldr(picture)[0]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.height, stream.width, stream.pix_fmt, stream.bit_rate = *color.shape[:2], "yuv420p", 4_000_000
        for index in range(frames):
            shown = np.rint(255 * srgb_encode(np.clip(color * (0.7 + 0.03 * index), 0, 1))).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")))
        container.mux(stream.encode())


@pytest.mark.parametrize("option", ["-o", "--confidence", "--save-overlay", "--save-mask"])
def test_a_photo_is_not_replaced_by_what_is_made_of_it(trained, opaque, tmp_path, capsys, option):
    photo = tmp_path / ("photo.png" if option.startswith("--save") else "photo.exr")
    color = read_ldr(opaque[0][0])[0]
    (write_png if photo.suffix == ".png" else write_exr)(photo, color)
    before = photo.read_bytes()
    output = [] if option == "-o" else ["-o", tmp_path / "light.exr"]
    words = [photo, "--mask", opaque[1] / opaque[0][0].name, *output, option, photo]
    fails(["predict", trained[1].path, *words], capsys, ["would be replaced"])
    assert photo.read_bytes() == before
    folder = tmp_path / "many"
    folder.mkdir()
    images = [folder / f"{name}.exr" for name in ("a", "b")]
    for image in images:
        write_exr(image, color)
    fails(["predict", trained[1].path, *images, "-o", folder], capsys, ["would be replaced"])


@pytest.mark.parametrize("more", [[], ["--one-light"]])
def test_files_of_a_camera_that_is_given_are_not_asked_for(trained, opaque, tmp_path, capsys, more):
    wanted = ["--save-overlay", tmp_path / "seen.png", "-o", tmp_path / "light.exr"]
    fails(
        ["predict", trained[1].path, opaque[0][0], *given(opaque), *wanted, *more], capsys, ["--save-overlay"]
    )
    assert not list(tmp_path.iterdir())
