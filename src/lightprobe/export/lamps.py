"""Suns and lamps as other programs' directional lights: a rotation, a colour and an intensity.

glTF's directional light shines along its node's -z (KHR_lights_punctual), USD's distant light along its own
-z, both in y-up frames: the node's +z points to the source.
"""

import math
from dataclasses import dataclass

import numpy as np

from lightprobe.export.gltf_mesh import to_y_up
from lightprobe.light.sources import LightSource


@dataclass(frozen=True)
class DirectionalLight:
    """A source in a y-up frame."""

    direction: np.ndarray  # (3,) unit, towards the source
    color: tuple[float, float, float]  # linear RGB, its largest value 1
    intensity: float  # irradiance of a surface that faces it; glTF's lux where a unit of the map is a cd/m^2
    angle: float  # degrees across its disc

    @staticmethod
    def of(source: LightSource) -> "DirectionalLight":
        """Return a source turned y-up; a black one is white with no intensity."""
        intensity = max(source.irradiance)
        r, g, b = (value / intensity if intensity > 0 else 1.0 for value in source.irradiance)
        angle = min(360.0, 2 * math.degrees(source.angular_radius))
        return DirectionalLight(to_y_up(np.asarray(source.direction)), (r, g, b), intensity, angle)

    def quaternion(self) -> tuple[float, float, float, float]:
        """Return the unit quaternion (x, y, z, w) of the shortest turn from +z to the direction."""
        x, y, z = (float(v) for v in self.direction)
        if z < -1 + 1e-9:  # half a turn about any axis across
            return 1.0, 0.0, 0.0, 0.0
        w = math.sqrt((1 + z) / 2)
        return -y / (2 * w), x / (2 * w), 0.0, w
