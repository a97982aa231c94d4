"""predict on photos of one light, on opaque photos with their background, and on a video."""

import json

import av
import numpy as np
import pytest
from PIL import Image

from lightprobe.cli.main import main
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
    assert main([str(argument) for argument in arguments]) == 3
    assert "same name" in capsys.readouterr().err
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
    images, masks, _ = opaque
    empty = tmp_path / "masks"
    for mask in masks.iterdir():
        write_png(
            empty / mask.name, read_ldr(mask, srgb=False)[0] * (mask.stem != images[1].stem), srgb=False
        )
    out = tmp_path / "light.exr"
    arguments = [
        "predict",
        trained[1].path,
        *images,
        "--camera",
        opaque[2],
        "--mask",
        empty,
        "--one-light",
        "-o",
        out,
    ]
    assert main([str(argument) for argument in arguments]) == 2
    assert f"{images[1]} is not in the map. " in capsys.readouterr().err
    assert out.is_file()


@pytest.mark.slow
def test_a_photo_that_is_white_all_over_is_left_out_and_named(trained, opaque, tmp_path, capsys):
    images = opaque[0]
    white, plain = tmp_path / images[0].name, tmp_path / "plain.exr"
    write_png(white, np.ones_like(read_ldr(images[0])[0]))
    light = tmp_path / "light.exr"
    arguments = ["predict", trained[1].path, white, images[1], *given(opaque), "--one-light", "-o", light]
    assert main([str(argument) for argument in arguments]) == 2
    assert f"{white} is not in the map. 100 % of the object's values are clipped" in capsys.readouterr().err
    succeed("predict", trained[1].path, images[1], *given(opaque), "--one-light", "-o", plain)
    np.testing.assert_array_equal(read_hdr(light), read_hdr(plain))


@pytest.mark.slow
def test_the_background_is_used_unless_told_otherwise(trained, opaque, tmp_path, capsys):
    image = opaque[0][0]
    succeed("predict", trained[1].path, image, *given(opaque), "-o", tmp_path / "with.exr")
    assert "; background " in capsys.readouterr().out
    succeed(
        "predict", trained[1].path, image, *given(opaque), "--no-background", "-o", tmp_path / "without.exr"
    )
    assert "; background " not in capsys.readouterr().out


@pytest.mark.long
def test_a_video_gives_a_map_for_every_few_frames_or_one_for_all(trained, opaque, tmp_path, capsys):
    clip = tmp_path / "clip.mp4"
    write_clip(clip, opaque[0][0], frames=7)
    mask = opaque[1] / opaque[0][0].name
    # One camera for the whole clip: that of a tripod.
    camera = tmp_path / "camera.json"
    camera.write_text(_camera_of(trained, opaque[0][0].stem))
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


def test_what_cannot_be_predicted_from_together_is_refused(trained, opaque, tmp_path, capsys):
    clip = tmp_path / "clip.mp4"
    write_clip(clip, opaque[0][0], frames=2)
    fails(["predict", trained[1].path, clip, opaque[0][0]], capsys, ["is a video; predict from it alone"])
    fails(["predict", trained[1].path, clip, "--one-light", "-o", tmp_path / "one.png"], capsys, ["one.png"])
    assert not (tmp_path / "one").exists()
    fails(
        ["predict", trained[1].path, opaque[0][0], "--every", "2"],
        capsys,
        ["--every is about a video's frames"],
    )
    fails(["predict", trained[1].path, clip, "--every", "0"], capsys, ["--every must be at least 1"])
    fails(["predict", trained[1].path, clip, "-o", tmp_path / "one.exr"], capsys, ["need a folder"])
    assert not (tmp_path / "one.exr").exists()


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


def _camera_of(trained, name):
    return json.dumps(trained[1].scene()["photos"]["test"][name]["camera"])


@pytest.mark.parametrize("option", ["-o", "--confidence", "--save-overlay", "--save-mask"])
def test_a_photo_is_not_replaced_by_what_is_made_of_it(trained, opaque, tmp_path, capsys, option):
    photo = tmp_path / ("photo.png" if option.startswith("--save") else "photo.exr")
    color = read_ldr(opaque[0][0])[0]
    (write_png if photo.suffix == ".png" else write_exr)(photo, color)
    before = photo.read_bytes()
    output = [] if option == "-o" else ["-o", tmp_path / "light.exr"]
    arguments = [
        "predict",
        trained[1].path,
        photo,
        "--mask",
        opaque[1] / opaque[0][0].name,
        *output,
        option,
        photo,
    ]
    fails(arguments, capsys, ["would be replaced"])
    assert photo.read_bytes() == before
    folder = tmp_path / "many"
    folder.mkdir()
    images = [folder / f"{name}.exr" for name in ("a", "b")]
    for image in images:
        write_exr(image, color)
    fails(["predict", trained[1].path, *images, "-o", folder], capsys, ["would be replaced"])


def test_files_of_a_camera_that_is_given_are_not_asked_for(trained, opaque, tmp_path, capsys):
    wanted = ["--save-overlay", tmp_path / "seen.png", "-o", tmp_path / "light.exr"]
    for more in ([], ["--one-light"]):
        fails(
            ["predict", trained[1].path, opaque[0][0], *given(opaque), *wanted, *more],
            capsys,
            ["--save-overlay"],
        )
    assert not list(tmp_path.iterdir())
