"""Gain maps in JPEGs: the radiance beyond white by the published formulas, and by Google's own library."""

import warnings

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import LightprobeWarning
from lightprobe.imaging import PhotoFile, foreign_encoding, image_size, read_ldr, read_photo, srgb_decode
from tests.imaging.apple_notes import apple_note
from tests.imaging.gain_files import iso_metadata, jpeg, write_gain_jpeg, xmp_metadata
from tests.imaging.icc_profiles import P3_PRIMARIES, icc, own_srgb

ONE = (0.0, 3.0, 1.0, 1 / 64, 1 / 64)  # min, max, gamma, offsets
THREE = ((-1.0, 2.0, 1.5, 1 / 64, 1 / 32), (0.0, 3.0, 1.0, 0.0, 0.0), (0.5, 1.0, 0.7, 1 / 64, 1 / 64))


def pair(channels=1):
    """A picture of four patches (64, 96, 3), one of them white, and a map of half its size."""
    picture = np.full((64, 96, 3), 255, np.uint8)
    picture[:32, 48:], picture[32:, :48], picture[32:, 48:] = 186, (186, 120, 60), 20
    second = np.full((32, 48, channels), 204, np.uint8)
    second[:, 24:], second[16:] = 102, 26 + second[16:] // 2
    if channels == 3:
        second[..., 1], second[..., 2] = 255 - second[..., 0], second[..., 0] // 2
    return picture, second.squeeze()


def patches(image):
    return image[[8, 8, 56, 56], [8, 88, 8, 88]]


def by_formula(picture, second, rows):
    """The formula of ISO 21496-1, written out for the middles of the patches."""
    base = srgb_decode(patches(picture) / 255)
    encoded = second.reshape(32, 48, -1)[[4, 4, 28, 28], [4, 44, 4, 44]] / 255
    low, high, gamma, below, above = np.array(rows).reshape(-1, 5).T
    return (base + below) * 2 ** (low + (high - low) * encoded ** (1 / gamma)) - above


@pytest.mark.parametrize("common", [False, True])
@pytest.mark.parametrize(("rows", "channels"), [((ONE,), 1), ((ONE,), 3), (THREE, 3), (THREE, 1)])
def test_iso_metadata(tmp_path, rows, channels, common):
    picture, second = pair(channels)
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, iso=iso_metadata(rows, common=common))
    expected = np.maximum(by_formula(picture, second, rows), 0)
    assert expected.max() > 2
    np.testing.assert_allclose(patches(read_ldr(path)[0]), expected, rtol=0.02, atol=0.002)


@pytest.mark.parametrize("sequence", [False, True])
def test_ultra_hdr_by_xmp(tmp_path, sequence):
    picture, second = pair(3 if sequence else 1)
    if sequence:
        names = ("GainMapMin", "GainMapMax", "Gamma", "OffsetSDR", "OffsetHDR")
        lists = ("".join(f"<rdf:li>{row[k]}</rdf:li>" for row in THREE) for k in range(5))
        elements = "".join(
            f"<hdrgm:{name}><rdf:Seq>{items}</rdf:Seq></hdrgm:{name}>"
            for name, items in zip(names, lists, strict=True)
        )
        xmp, rows = xmp_metadata(elements=elements), THREE
    else:  # what is left out has the value that the specification gives it
        xmp, rows = xmp_metadata('hdrgm:GainMapMax="3" hdrgm:HDRCapacityMax="3"'), (ONE,)
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, xmp=xmp)
    expected = np.maximum(by_formula(picture, second, rows), 0)
    np.testing.assert_allclose(patches(read_ldr(path)[0]), expected, rtol=0.02, atol=0.002)


def test_what_googles_library_writes_reads_as_it_reads_it(tmp_path):
    light = np.ones((64, 96, 4), np.float16)
    light[:32, :48, :3], light[:32, 48:, :3], light[32:, :48, :3], light[32:, 48:, :3] = 12, 3, 0.6, 0.1
    data = imagecodecs.ultrahdr_encode(light)
    (tmp_path / "a.jpg").write_bytes(data)
    found = patches(read_ldr(tmp_path / "a.jpg")[0])
    np.testing.assert_allclose(found, patches(imagecodecs.ultrahdr_decode(data))[:, :3], rtol=0.02)
    np.testing.assert_allclose(found, patches(light)[:, :3], rtol=0.02)


def test_samples_between_those_of_the_map(tmp_path):
    """A ramp of the map is a ramp of stops over a white picture, held at its ends."""
    ramp = np.tile(np.linspace(0, 255, 12).round().astype(np.uint8), (8, 1))
    white = np.full((32, 48, 3), 255, np.uint8)
    path = write_gain_jpeg(tmp_path / "a.jpg", white, ramp, iso=iso_metadata([(0, 4, 1, 0, 0)]))
    across = np.interp((np.arange(48) + 0.5) / 4 - 0.5, np.arange(12), np.linspace(0, 1, 12))
    stops = np.log2(read_ldr(path)[0])
    np.testing.assert_allclose(stops, np.broadcast_to(4 * across[None, :, None], stops.shape), atol=0.03)


def test_rows_are_those_of_the_whole(tmp_path):
    picture, second = pair()
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, iso=iso_metadata([ONE]))
    photo, (color, _, clipped) = PhotoFile(path), read_photo(path)
    np.testing.assert_array_equal(photo.rows(27, 40)[0], color[27:40])
    np.testing.assert_array_equal(photo.clipped_rows(27, 40), clipped[27:40])


def test_white_is_clipped_only_where_the_map_is_at_its_end(tmp_path):
    picture, second = pair()
    second[:8] = 255
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, iso=iso_metadata([ONE]))
    clipped = read_photo(path)[2]
    assert clipped[:12, :40].all()
    assert not clipped[20:].any()
    assert not clipped[:, 52:].any()  # the map is at its end there, too, but the picture is not white
    (tmp_path / "b.jpg").write_bytes(jpeg(picture))
    assert read_photo(tmp_path / "b.jpg")[2][:28, :44].all()


@pytest.mark.parametrize("turn", [1, 3, 6, 7])
def test_the_map_is_turned_with_its_picture(tmp_path, turn):
    picture, second = pair()
    exif = Image.Exif()
    exif[0x0112] = turn
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, iso=iso_metadata([ONE]), exif=exif.tobytes())
    stored, color = read_ldr(path, orient=False)[0], read_ldr(path)[0]
    assert image_size(path) == ((96, 64) if turn < 5 else (64, 96))
    turned = {1: stored, 3: stored[::-1, ::-1], 6: stored[::-1].swapaxes(0, 1)}
    turned[7] = stored[::-1, ::-1].swapaxes(0, 1)
    np.testing.assert_allclose(color, turned[turn], rtol=1e-5)


def test_the_gain_is_of_the_pictures_primaries(tmp_path):
    """Of three channels this is another colour than in sRGB's."""
    picture, second = pair(3)
    profile = icc("Wide Thing", P3_PRIMARIES, 2.2)
    told = iso_metadata(THREE)
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, iso=told, icc_profile=profile)
    assert foreign_encoding(path) == "ICC profile Wide Thing"
    to_srgb = np.array([[1.2249, -0.2247, 0], [-0.0420, 1.0419, 0], [-0.0197, -0.0786, 1.0979]])
    low, high, gamma, below, above = np.array(THREE).T
    encoded = (second / 255)[[4, 4, 28, 28], [4, 44, 4, 44]]
    gain = 2 ** (low + (high - low) * encoded ** (1 / gamma))
    base = (patches(picture) / 255) ** 2.2
    expected = np.maximum(((base + below) * gain - above) @ to_srgb.T, 0)
    np.testing.assert_allclose(patches(read_ldr(path)[0]), expected, rtol=0.02, atol=0.006)
    other = iso_metadata(THREE, base_colors=False)  # of the map's own primaries, by its profile
    path = write_gain_jpeg(
        tmp_path / "b.jpg", picture, second, iso=other, icc=own_srgb(), icc_profile=profile
    )
    expected = np.maximum(((base @ to_srgb.T) + below) * gain - above, 0)
    np.testing.assert_allclose(patches(read_ldr(path)[0]), expected, rtol=0.02, atol=0.006)
    wide = write_gain_jpeg(tmp_path / "c.jpg", picture, second, iso=other, icc=profile)
    base = srgb_decode(patches(picture) / 255) @ np.linalg.inv(to_srgb).T
    expected = np.maximum(((base + below) * gain - above) @ to_srgb.T, 0)
    np.testing.assert_allclose(patches(read_ldr(wide)[0]), expected, rtol=0.02, atol=0.006)


def test_apples_jpeg(tmp_path):
    """As exported by its Photos: the headroom stands in the camera's note of the picture."""
    picture, second = pair()
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x927C] = apple_note({33: [1.0], 48: [0.005]})
    kind = b"<apdi:AuxiliaryImageType>urn:com:apple:photo:2020:aux:hdrgainmap</apdi:AuxiliaryImageType>"
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, xmp=kind, exif=exif.tobytes())
    headroom = 2 ** (3 - 70 * 0.005)
    encoded = second[[4, 4, 28, 28], [4, 44, 4, 44]] / 255
    light = ((encoded + 0.099) / 1.099) ** (1 / 0.45)
    expected = srgb_decode(patches(picture) / 255) * (1 + (headroom - 1) * light)[:, None]
    np.testing.assert_allclose(patches(read_ldr(path)[0]), expected, rtol=0.02, atol=0.002)


def test_a_picture_that_is_the_brighter_one_is_left_as_it_is(tmp_path):
    picture, second = pair()
    (tmp_path / "plain.jpg").write_bytes(jpeg(picture))
    expected = read_ldr(tmp_path / "plain.jpg")[0]
    bright = xmp_metadata('hdrgm:GainMapMax="3" hdrgm:HDRCapacityMax="3" hdrgm:BaseRenditionIsHDR="True"')
    for told in ({"iso": iso_metadata([ONE], (3.0, 0.0))}, {"xmp": bright}):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            color = read_ldr(write_gain_jpeg(tmp_path / "a.jpg", picture, second, **told))[0]
        np.testing.assert_array_equal(color, expected)


def test_a_second_picture_of_another_kind_is_left_aside(tmp_path):
    """Such as the other eye's, or a preview."""
    picture, second = pair()
    (tmp_path / "plain.jpg").write_bytes(jpeg(picture))
    path = write_gain_jpeg(tmp_path / "a.mpo", picture, second)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        color = read_ldr(path)[0]
    np.testing.assert_array_equal(color, read_ldr(tmp_path / "plain.jpg")[0])


def test_maps_are_not_brightened(tmp_path):
    picture, second = pair()
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, iso=iso_metadata([ONE]))
    assert read_ldr(path, srgb=False)[0].max() == 1


HUGE, NO_GAMMA = (0.0, 99.0, 1.0, 0.0, 0.0), (0.0, 2.0, 0.0, 0.0, 0.0)
XML = b'<!DOCTYPE x [<!ENTITY a "b">]><x xmlns:h="http://ns.adobe.com/hdr-gain-map/1.0/">&a;</x>'


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"iso": iso_metadata([ONE]), "indexed": False}, "its second picture is missing"),
        ({"xmp": xmp_metadata('hdrgm:GainMapMax="3"'), "indexed": False}, "its second picture is missing"),
        ({"iso": iso_metadata([HUGE])}, "its metadata have numbers that no gain map has"),
        ({"iso": iso_metadata([NO_GAMMA])}, "its metadata have numbers that no gain map has"),
        (
            {"iso": iso_metadata([ONE]).replace((2**16).to_bytes(4, "big"), bytes(4))},
            "numbers that no gain map",
        ),
        ({"iso": iso_metadata([ONE], version=1)}, "version 1 of its metadata is unknown"),
        ({"iso": iso_metadata([ONE])[:20]}, "unpack_from requires"),
        ({"xmp": xmp_metadata()}, "its XMP has no GainMapMax"),
        ({"xmp": xmp_metadata('hdrgm:GainMapMax="much"')}, "could not convert string to float"),
        ({"xmp": xmp_metadata('hdrgm:GainMapMax="1"')[:-20]}, "its XMP is damaged"),
        ({"xmp": XML}, "its XMP declares entities"),
        ({"xmp": b"urn:com:apple:photo:2020:aux:hdrgainmap"}, "the camera's note"),
    ],
)
def test_a_map_that_cannot_be_read_is_one_sentence(tmp_path, options, reason):
    picture, second = pair()
    path = write_gain_jpeg(tmp_path / "a.jpg", picture, second, **options)
    (tmp_path / "plain.jpg").write_bytes(jpeg(picture))
    with pytest.warns(
        LightprobeWarning, match=rf"a\.jpg has a gain map that is not read \(.*{reason}"
    ) as said:
        color = read_ldr(path)[0]
    np.testing.assert_array_equal(color, read_ldr(tmp_path / "plain.jpg")[0])
    assert len(said) == 1
    assert str(said[0].message).endswith("save the photo as Ultra HDR JPEG, or use the camera raw file.")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # said once for each photo, which is decoded many times
        read_ldr(path)


def test_a_map_larger_than_its_picture_is_left_aside(tmp_path):
    large = np.full((200, 300), 80, np.uint8)
    path = write_gain_jpeg(tmp_path / "a.jpg", pair()[0], large, iso=iso_metadata([ONE]))
    with pytest.warns(LightprobeWarning, match="it is larger than its picture"):
        assert read_ldr(path)[0].max() == 1


def test_a_map_that_is_cut_short(tmp_path):
    noise = np.random.default_rng(1).integers(0, 256, (32, 48), dtype=np.uint8)
    path = write_gain_jpeg(tmp_path / "a.jpg", pair()[0], noise, iso=iso_metadata([ONE]))
    path.write_bytes(path.read_bytes()[:-900])
    with pytest.warns(LightprobeWarning, match=r"gain map that is not read \(image file is truncated"):
        assert read_ldr(path)[0].max() == 1
