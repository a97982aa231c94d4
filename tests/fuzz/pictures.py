"""Tiny valid pictures of every kind that is read, as small as shows every part of their formats."""

from pathlib import Path

import numpy as np
import OpenEXR
import pillow_heif
import tifffile
from PIL import Image, PngImagePlugin

from lightprobe.imaging import png16, write_exr, write_radiance
from tests.imaging import heif_files
from tests.imaging.apple_notes import apple_note
from tests.imaging.gain_files import iso_metadata, write_gain_jpeg, xmp_metadata
from tests.imaging.icc_profiles import P3_PRIMARIES, grey_icc, icc
from tests.imaging.raw_files import lens_shading, opcode_list, write_dng, write_linear_dng

_RNG = np.random.default_rng(26)
_COLOR = _RNG.integers(0, 256, (12, 16, 3), np.uint8)
_ALPHA = np.dstack([_COLOR, _RNG.integers(0, 256, (12, 16), np.uint8)])
_DEEP = _RNG.integers(0, 65536, (12, 16, 4), np.uint16)
_LIGHT = _RNG.random((12, 16, 3)).astype(np.float32)
_PROFILE = icc("Display P3", P3_PRIMARIES, 2.2)


def _exif() -> bytes:
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769).update({0x829A: 0.01, 0x829D: 2.8, 0x8827: 100, 0x920A: 5.0, 0xA405: 28})
    return exif.tobytes()


def _save(path: Path, picture: np.ndarray | Image.Image, **options: object) -> None:
    (picture if isinstance(picture, Image.Image) else Image.fromarray(picture)).save(path, **options)


def write_png(folder: Path) -> None:
    """Write PNG of 8 and 16 bits, with a palette, interlaced text, a profile, code points and EXIF."""
    info = PngImagePlugin.PngInfo()
    info.add(b"cICP", bytes((12, 16, 0, 1)))
    info.add_text("words", "a" * 40, zip=True)
    palette = Image.fromarray(_COLOR).quantize(16)
    palette.info["transparency"] = 3
    _save(folder / "8.png", _COLOR, icc_profile=_PROFILE, exif=_exif())
    _save(folder / "alpha.png", _ALPHA, pnginfo=info)
    _save(folder / "palette.png", palette, transparency=3)
    _save(folder / "grey.png", _COLOR[..., 0], icc_profile=grey_icc("grey", 2.2))
    _save(folder / "bits.png", Image.fromarray(_COLOR[..., 0]).convert("1"))
    (folder / "16.png").write_bytes(png16.encode(_DEEP))
    (folder / "16grey.png").write_bytes(png16.encode(_DEEP[..., :1]))


def write_jpeg(folder: Path) -> None:
    """Write JPEG: plain, progressive, grey and in inks, with profile and EXIF, with gain maps."""
    _save(folder / "plain.jpg", _COLOR, icc_profile=_PROFILE, exif=_exif())
    _save(folder / "progressive.jpg", _COLOR, progressive=True, subsampling=0)
    _save(folder / "grey.jpg", _COLOR[..., 0])
    _save(folder / "cmyk.jpg", Image.fromarray(_COLOR).convert("CMYK"))
    iso, xmp = iso_metadata([(0, 3, 1.5, 0, 0)]), xmp_metadata('hdrgm:GainMapMax="3"')
    write_gain_jpeg(folder / "iso.jpg", _COLOR, _COLOR[::2, ::2], iso=iso)
    write_gain_jpeg(folder / "xmp.jpg", _COLOR, _COLOR[::2, ::2, 0], xmp=xmp)


def write_webp(folder: Path) -> None:
    """Write WebP: lossy, lossless, with alpha, profile and EXIF."""
    _save(folder / "lossy.webp", _COLOR)
    _save(folder / "lossless.webp", _COLOR, lossless=True)
    _save(folder / "extended.webp", _ALPHA, icc_profile=_PROFILE, exif=_exif())


def write_tiff(folder: Path) -> None:
    """Write TIFF of 8 and 16 bits and of floats, in strips and tiles, compressed in several ways."""
    tifffile.imwrite(folder / "8.tif", _COLOR, photometric="rgb", iccprofile=_PROFILE)
    tifffile.imwrite(folder / "16.tif", _DEEP[..., :3], photometric="rgb", compression="zlib", predictor=True)
    tifffile.imwrite(folder / "alpha.tif", _DEEP, photometric="rgb", extrasamples=["assocalpha"])
    tifffile.imwrite(folder / "float.tif", _LIGHT, photometric="rgb", tile=(16, 16))
    tifffile.imwrite(folder / "grey.tif", _COLOR[..., 0], bigtiff=True, rowsperstrip=4)
    for name, compression in (("lzw", "tiff_lzw"), ("deflate", "tiff_adobe_deflate"), ("jpeg", "jpeg")):
        _save(folder / f"{name}.tif", _COLOR, compression=compression)


def write_heic(folder: Path) -> None:
    """Write HEIC of 8 and 10 bits, with alpha and with a gain map, and AVIF."""
    side = 64  # the codec's least
    color = np.kron(_ALPHA[:8, :8], np.ones((side // 8, side // 8, 1), np.uint8))
    told = {"exif": _exif(), "icc_profile": _PROFILE}
    pillow_heif.from_pillow(Image.fromarray(color[..., :3])).save(folder / "8.heic", quality=80, **told)
    pillow_heif.from_pillow(Image.fromarray(color)).save(folder / "alpha.heic", quality=80)
    deep = np.ascontiguousarray(color[..., :3]).astype(np.uint16) * 257
    pillow_heif.from_bytes(mode="RGB;16", size=(side, side), data=deep.tobytes()).save(
        folder / "10.heic", quality=80
    )
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x927C] = apple_note({33: [1.0], 48: [0.0]})
    heif_files.write_heif(folder / "gain.heic", color[..., :3], auxiliary=color[..., 0], exif=exif.tobytes())
    Image.fromarray(color).save(folder / "alpha.avif", quality=80)


def write_exrs(folder: Path) -> None:
    """Write OpenEXR in scan lines and tiles, of halves and floats, in several compressions."""
    light = _LIGHT[:8]
    write_exr(folder / "zip.exr", light)
    write_exr(folder / "alpha.exr", np.dstack([light, light[..., :1]]), half=True)
    planes = {name: np.ascontiguousarray(light[..., k]) for k, name in enumerate("RGB")}
    for name in ("PIZ", "RLE", "NO", "B44", "DWAA", "PXR24"):
        header = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION"), "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, planes).write(str(folder / f"{name.lower()}.exr"))
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 8
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tiles}
    OpenEXR.File(header, planes).write(str(folder / "tiles.exr"))


def write_radiances(folder: Path) -> None:
    """Write Radiance maps with runs, and too narrow for them."""
    runs = np.repeat(_LIGHT[:8, :4], 4, 1)
    write_radiance(folder / "runs.hdr", runs)
    write_radiance(folder / "narrow.hdr", _LIGHT[:3, :6])


def write_raw(folder: Path) -> None:
    """Write a camera raw file."""
    mosaic = _RNG.random((24, 32, 3))
    write_dng(folder / "camera.dng", mosaic, orientation=6, focal_35=28)
    shading = opcode_list(lens_shading(1 + _RNG.random((2, 3)), size=(24, 32)))
    write_dng(folder / "shaded.dng", mosaic, extra=[shading])
    write_linear_dng(folder / "linear.dng", mosaic, blacks=(64, 64, 64), white=4095)
