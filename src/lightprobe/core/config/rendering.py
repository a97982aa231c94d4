"""How pictures under a known light are made."""

from dataclasses import dataclass
from enum import StrEnum

from lightprobe.core.errors import ConfigError


class Renderer(StrEnum):
    """What makes a picture."""

    FAST = "fast"
    """The project's own: prefiltered light, shadows in 384 directions and of eight suns, one bounce."""
    PATH = "path"
    """A path tracer: sharp shadows and up to five bounces, some seconds a picture; needs the extra `path`."""


@dataclass(frozen=True)
class RenderConfig:
    """A renderer and what it may cost."""

    renderer: Renderer = Renderer.FAST
    samples: int = 256
    """Rays of each pixel, where they are traced; noise falls with the square root."""

    def __post_init__(self) -> None:
        """Raise `ConfigError` for a number of rays that makes no picture."""
        if not 1 <= self.samples <= 65_536:
            raise ConfigError(f"--samples {self.samples} must be from 1 to 65536 rays a pixel.")


FAST_PICTURES = RenderConfig()
