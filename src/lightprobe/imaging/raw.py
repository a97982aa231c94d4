"""Camera raw (DNG, CR2, CR3, NEF, ARW, ...) by LibRaw: demosaiced, linear, in the camera's own white balance.

Brightness is not stretched and highlights are not reconstructed: white is where the camera's green saturates,
and all that is brighter is cut there, so that clipped pixels can be told before primaries are converted. Lens
shading that a DNG file describes is undone; other corrections of the lens that it asks for are left aside.
"""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lightprobe.core.extras import photo_library
from lightprobe.core.muted import muted
from lightprobe.imaging.dng import check_dng, even_out, shadings
from lightprobe.imaging.encodings import LINEAR, Encoding, camera_matrix, linear
from lightprobe.imaging.limits import check_pixels
from lightprobe.imaging.opening import FileKind, Header, Samples, decode_errors, file_kind
from lightprobe.imaging.tags import EXIF_FOLDER, loaded_exif

_TURNS = {0: 1, 3: 3, 5: 8, 6: 6}  # LibRaw's flip -> EXIF orientation
_PIXEL_BYTES = 24.0  # memory estimate: the mosaic, four planes to interpolate it in, and colours twice
_EXPOSURE_TIME, _F_NUMBER, _ISO, _FOCAL_LENGTH = 0x829A, 0x829D, 0x8827, 0x920A  # numbers of EXIF tags


def read_header(path: Path) -> Header:
    """Return what stands beside the mosaic."""
    with _opened(path) as raw, decode_errors(path):
        sizes = raw.sizes
        check_pixels(path, sizes.width, sizes.height)
        exif = _exif(path, raw)
        return Header((sizes.width, sizes.height), exif, _TURNS.get(sizes.flip, 1), LINEAR, _PIXEL_BYTES)


def decode(path: Path) -> Samples:
    """Return the demosaiced samples (H, W, 3) uint16, linear camera values."""
    library = photo_library("rawpy", path)
    with _opened(path) as raw, decode_errors(path), muted():
        check_pixels(path, raw.sizes.width, raw.sizes.height)
        try:
            encoding = _encoding(raw)
            if raw.raw_type is library.RawType.Flat and file_kind(path) is FileKind.TIFF:
                even_out(raw, shadings(path))
            values = raw.postprocess(
                output_color=library.ColorSpace.raw,
                output_bps=16,
                gamma=(1, 1),
                user_flip=0,
                use_camera_wb=True,
                no_auto_bright=True,
                highlight_mode=library.HighlightMode.Clip,
                adjust_maximum_thr=0.0,  # white is the sensor's, not the brightest pixel of this photo
                user_sat=_saturation(raw, library),
            )
        except library.LibRawError as error:
            raise ValueError(_reason(error)) from error
    return Samples(values, encoding, 65535)


def _opened(path: Path) -> Any:
    library = photo_library("rawpy", path)
    if file_kind(path) is FileKind.TIFF:
        check_dng(path)
    with decode_errors(path), muted():
        try:
            return library.imread(str(path))
        except library.LibRawError as error:
            raise ValueError(_reason(error)) from error


def _saturation(raw: Any, library: Any) -> int | None:
    """Return the level at which colours that are no mosaic saturate, None where LibRaw knows.

    It takes the least black of four channels off the level of white, and the fourth of three is 0.
    """
    *blacks, fourth = raw.black_level_per_channel
    if raw.raw_type is library.RawType.Flat or fourth or not min(blacks):
        return None
    return int(raw.white_level) - min(blacks)


def _reason(error: Exception) -> str:
    text = error.args[0] if error.args else error
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)


def _encoding(raw: Any) -> Encoding:
    """Return camera values to linear sRGB: by LibRaw's own matrix, or one from the camera's response."""
    own, from_xyz = np.asarray(raw.color_matrix)[:3, :3], np.asarray(raw.rgb_xyz_matrix)[:3, :3]
    matrix = own if own.any() else camera_matrix(from_xyz) if np.linalg.matrix_rank(from_xyz) == 3 else None
    return Encoding(None, (linear,), None if matrix is None else matrix.astype(np.float64))


def _exif(path: Path, raw: Any) -> Image.Exif:
    """Return the EXIF entries of a file that is a TIFF inside; of others what LibRaw tells."""
    if file_kind(path) is FileKind.TIFF:
        return loaded_exif(path)
    exif, other = loaded_exif(None), raw.other
    told = (other.shutter_speed, other.aperture, other.iso_speed, other.focal_length)
    tags = zip((_EXPOSURE_TIME, _F_NUMBER, _ISO, _FOCAL_LENGTH), told, strict=True)
    exif.get_ifd(EXIF_FOLDER).update({tag: float(value) for tag, value in tags if value > 0})
    return exif
