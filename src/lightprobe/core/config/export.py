"""How an object and its light are written for other programs."""

from dataclasses import dataclass
from enum import StrEnum

from lightprobe.core.errors import ConfigError


class ColorSpace(StrEnum):
    """The primaries of a map in OpenEXR; it is linear in either."""

    SRGB = "srgb"
    """Those of sRGB (Rec. 709), white D65, which a file without a word on them has."""
    ACESCG = "acescg"
    """AP1 of ACEScg, white about D60, named in the file (`chromaticities`)."""


class Dome(StrEnum):
    """USD's schema of a light from all around."""

    TURNED = "DomeLight"
    """Of every version of USD, its pole at +y."""
    POLE_AXIS = "DomeLight_1"
    """From USD 23.11 on; names the axis of its pole (`poleAxis`), so that it stays right in a z-up scene."""


@dataclass(frozen=True)
class ExportOptions:
    """What is written, and how."""

    height: int | None = None
    """Rows of all maps, by default their own."""
    color_space: ColorSpace = ColorSpace.SRGB
    """Of the maps in OpenEXR."""
    usd: bool = False
    """Also scene.usdc and scene.usdz."""
    dome: Dome = Dome.TURNED
    """Schema of the light in these."""
    materialx: bool = False
    """Also material.mtlx."""

    def check(self, light: bool) -> None:
        """Raise `ConfigError` for a choice about a file that is not written; light: whether there is one."""
        if self.dome is not Dome.TURNED and not (self.usd and light):
            raise ConfigError(
                f"--dome {self.dome.value} is about the light in scene.usdc; add --usd and --env, or leave it out."
            )
