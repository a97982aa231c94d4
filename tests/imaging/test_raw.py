"""Camera raw as telephones write it: colours that are no mosaic, several bits, lens shading, kinds not read."""

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.imaging import PhotoFile, image_size, read_ldr, read_photo
from tests.imaging.raw_files import (
    NEUTRAL,
    XYZ_TO_CAMERA,
    lens_shading,
    opcode_list,
    write_dng,
    write_linear_dng,
)

SRGB_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
SIZE = (48, 64)


def halves():
    """Grey of .4 (white balanced), and a colour of which red and green saturate."""
    camera = np.empty((*SIZE, 3))
    camera[:, :32], camera[:, 32:] = 0.4 * np.array(NEUTRAL), (1.0, 1.0, 0.3)
    return camera


def linear(camera):
    """Linear sRGB of camera values (3,): balanced, cut at the white of green, and by the file's matrix."""
    matrix = XYZ_TO_CAMERA @ SRGB_TO_XYZ
    balanced = np.minimum(np.array(camera) / NEUTRAL, 1)
    return np.maximum(np.linalg.solve(matrix / matrix.sum(axis=1, keepdims=True), balanced), 0)


@pytest.mark.parametrize(
    ("blacks", "white"),
    [((0, 0, 0), 65535), ((0,), 4095), ((256,), 4095), ((256, 256, 256), 4095), ((528, 528, 528), 65535)],
)
def test_colours_that_are_no_mosaic(tmp_path, blacks, white):
    path = write_linear_dng(tmp_path / "a.dng", halves(), blacks=blacks, white=white)
    color, alpha, clipped = read_photo(path)
    assert alpha is None
    np.testing.assert_allclose(color[:, :32], 0.4, atol=0.001)
    np.testing.assert_allclose(color[:, 32:], np.broadcast_to(linear((1, 1, 0.3)), (48, 32, 3)), atol=0.003)
    np.testing.assert_array_equal(clipped[24, 50], [True, True, False])
    assert not clipped[:, :32].any()


@pytest.mark.parametrize("bits", [12, 14, 16])
def test_a_mosaic_of_packed_bits(tmp_path, bits):
    path = write_dng(tmp_path / "a.dng", halves(), bitspersample=bits)
    color, _, clipped = read_photo(path)
    np.testing.assert_allclose(color[4:-4, 4:28], 0.4, atol=0.001)
    np.testing.assert_allclose(color[24, 50], linear((1, 1, 0.3)), atol=0.003)
    np.testing.assert_array_equal(clipped[24, 50], [True, True, False])


def test_an_active_area_and_levels_of_a_table(tmp_path):
    """Masked columns at a sensor's edge are no picture; levels may be coded by their roots."""
    area = (50829, "I", 4, (4, 8, 44, 56), True)  # top, left, bottom, right
    path = write_dng(tmp_path / "a.dng", halves(), extra=[area])
    color = read_ldr(path)[0]
    assert image_size(path) == (48, 40)
    np.testing.assert_allclose(color[4:-4, 4:20], 0.4, atol=0.001)
    table = np.rint((np.arange(4096) / 4095) ** 2 * 4031 + 64).astype(int)
    coded = np.sqrt(halves()) * (4095 / 4031) - 64 / 4031  # what `write_dng` makes 4095 times the root
    path = write_dng(tmp_path / "b.dng", coded, extra=[(50712, "H", 4096, tuple(table.tolist()), True)])
    np.testing.assert_allclose(read_ldr(path)[0][4:-4, 4:28], 0.4, atol=0.001)


def test_blacks_that_differ_a_little(tmp_path):
    """As sensors' do: levels are LibRaw's, to a few thousandths, and what is clipped is told."""
    path = write_linear_dng(tmp_path / "a.dng", halves(), blacks=(250, 256, 260), white=4095)
    color, _, clipped = read_photo(path)
    np.testing.assert_allclose(color[:, :32], 0.4, atol=0.002)
    np.testing.assert_array_equal(clipped[24, 50], [True, True, False])


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_it_is_turned(tmp_path, orientation):
    path = write_linear_dng(tmp_path / "a.dng", halves(), orientation=orientation)
    bright = {1: (24, 50), 3: (24, 14), 6: (50, 24), 8: (14, 24)}[orientation]
    color = read_ldr(path)[0]
    assert image_size(path) == color.shape[1::-1] == ((64, 48) if orientation < 5 else (48, 64))
    np.testing.assert_allclose(color[bright], linear((1, 1, 0.3)), atol=0.003)


def corner_gains(strength):
    """Gains of 9 x 13 points that rise from 1 in the middle."""
    down, across = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 13), indexing="ij")
    return 1 + strength * (down**2 + across**2)


def over(gains):
    """Gains from edge to edge at the pixels, by linear interpolation along both axes."""
    rows, columns = ((np.arange(length) + 0.5) / length for length in SIZE)
    points = [np.linspace(0, 1, length) for length in gains.shape]
    down = np.array([np.interp(rows, points[0], column) for column in gains.T]).T
    return np.array([np.interp(columns, points[1], row) for row in down])


def test_lens_shading_is_undone(tmp_path):
    """Each of a mosaic's four colours has a map of its own."""
    strengths = (0.6, 0.4, 0.4, 0.8)
    maps = [
        lens_shading(corner_gains(strength), size=SIZE, cell=(k // 2, k % 2))
        for k, strength in enumerate(strengths)
    ]
    darkened = np.stack(
        [0.3 * n / over(corner_gains(s)) for n, s in zip(NEUTRAL, (0.6, 0.4, 0.8), strict=True)], 2
    )
    plain = read_ldr(write_dng(tmp_path / "plain.dng", darkened))[0]
    assert plain[3, 3, 1] < 0.25
    color, _, clipped = read_photo(write_dng(tmp_path / "a.dng", darkened, extra=[opcode_list(*maps)]))
    np.testing.assert_allclose(color[2:-2, 2:-2], 0.3, atol=0.003)
    assert not clipped.any()


def test_what_shading_lifts_above_white_is_clipped(tmp_path):
    camera = np.broadcast_to(0.7 * np.array(NEUTRAL), (*SIZE, 3))
    everywhere = lens_shading(np.array([[1.0, 2.0]]), size=SIZE, step=1)
    path = write_dng(tmp_path / "a.dng", camera, extra=[opcode_list(everywhere)])
    clipped = PhotoFile(path).clipped_rows(0, 48)
    assert not clipped[4:-4, :20, 1].any()
    assert clipped[4:-4, -20:, 1].all()
    single = lens_shading(np.array([[1.25]]), size=SIZE, step=1)
    color = read_ldr(write_dng(tmp_path / "b.dng", camera, extra=[opcode_list(single)]))[0]
    np.testing.assert_allclose(color[4:-4, 4:-4], 0.875, atol=0.002)
    beyond = lens_shading(np.array([[23.25]]), size=SIZE, step=1)  # 65 600 of green, more than 16 bits
    path = write_dng(tmp_path / "c.dng", camera, extra=[opcode_list(beyond)])
    assert PhotoFile(path).clipped_rows(0, 48)[..., 1].all()


@pytest.mark.parametrize("spoil", ["points", "gain", "cut", "pitch", "count"])
def test_damaged_shading_is_one_sentence(tmp_path, spoil):
    gains = np.full((2, 2), 1e9 if spoil == "gain" else 1.5)
    good = lens_shading(gains, size=SIZE, step=0 if spoil == "pitch" else 2)
    changed = {"points": good[:48] + b"\xff" * 8 + good[56:], "cut": good[:-6]}.get(spoil, good)
    tag = opcode_list(changed)
    if spoil == "count":
        tag = (*tag[:3], b"\xff" * 4 + tag[3][4:], True)
    path = write_dng(tmp_path / "a.dng", halves(), extra=[tag])
    with pytest.raises(
        InputError, match=r"a\.dng cannot be decoded .* the file is damaged or cut short: copy it again\.$"
    ):
        read_ldr(path)


@pytest.mark.parametrize("read", [read_ldr, image_size])
def test_raw_of_kinds_that_are_not_read(tmp_path, read):
    merged = write_linear_dng(tmp_path / "a.dng", halves(), white=1, dtype=np.float32)
    with pytest.raises(
        InputError, match=r"a\.dng is a DNG of floats .* save it as OpenEXR or as TIFF of floats\.$"
    ):
        read(merged)
    small = write_linear_dng(tmp_path / "b.dng", halves(), compression="jpegxl_dng")
    with pytest.raises(
        InputError, match=r"b\.dng is a DNG compressed as JPEG XL, .* set the camera to lossless JPEG"
    ):
        read(small)
