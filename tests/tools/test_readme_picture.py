"""The README's picture: three panels of one size above their captions, and a pawn that stands upright."""

import numpy as np
import trimesh
from PIL import Image

from readme_picture import CAPTION, CAPTIONS, GAP, HEIGHT, SIDE, joined, light_panel, make_pawn


def test_panels_of_any_size_stand_side_by_side():
    page = joined([Image.new("RGB", size, "red") for size in ((SIDE, SIDE), (SIDE, HEIGHT), (640, 480))])
    assert page.size == (len(CAPTIONS) * (SIDE + GAP) - GAP, HEIGHT + CAPTION)
    shown = np.asarray(page)
    for column in range(len(CAPTIONS)):
        left = column * (SIDE + GAP)
        assert (shown[:HEIGHT, left : left + SIDE] == (255, 0, 0)).all()
        assert (shown[HEIGHT:, left : left + SIDE] < 128).any()  # the caption


def test_the_balls_are_bright_on_the_side_of_the_light():
    light = np.full((32, 64, 3), 0.2, np.float32)
    light[:8] = 2.0  # from above
    panel = np.asarray(light_panel(light, np.eye(4)[:, [0, 2, 1, 3]]), float)
    assert panel[: SIDE // 8].mean() > panel[SIDE // 4 : SIDE // 2].mean()
    balls = panel[SIDE // 2 :]
    third = len(balls) // 3
    assert balls[:third].sum() > 1.1 * balls[-third:].sum()


def test_the_pawn_stands_upright(tmp_path):
    make_pawn(tmp_path / "pawn.glb")
    size = np.ptp(trimesh.load(tmp_path / "pawn.glb").bounds, axis=0)
    assert size.argmax() == 1  # glTF is y-up
    assert size[1] > 1.5 * size[0]
