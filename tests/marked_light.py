"""A light of six colours, one for each axis, and a frame that is far from the normalised one."""

import numpy as np
import torch

from lightprobe.light import cubemap
from lightprobe.scene.camera import Similarity

# Where the light of each colour comes from, in the user's z-up frame; all values are exact in both file
# formats.
COLORS = {
    (1, 0, 0): (1.0, 0.125, 0.125),
    (-1, 0, 0): (0.125, 1.0, 1.0),
    (0, 1, 0): (0.125, 1.0, 0.125),
    (0, -1, 0): (1.0, 0.125, 1.0),
    (0, 0, 1): (0.25, 0.25, 4.0),
    (0, 0, -1): (1.0, 1.0, 0.125),
}
SIMILARITY = Similarity(np.array([0.5, 2.0, -1.0]), 3.0)


def marked_cubemap(resolution: int = 16) -> torch.Tensor:
    """Every texel has the colour of the axis nearest to its direction."""
    directions = cubemap.directions(resolution)
    axes = torch.tensor(list(COLORS), dtype=torch.float32)
    return torch.tensor(list(COLORS.values()))[(directions @ axes.T).argmax(-1)]
