import numpy as np

from lightprobe.scene.overlay import GAP, PAPER, Cell, contact_sheet, outline


def test_an_outline_is_as_wide_as_asked_and_leaves_the_border_of_the_picture():
    shape = np.zeros((9, 9), bool)
    shape[:, 2:7] = True
    assert np.flatnonzero(outline(shape)[4]).tolist() == [2, 6]
    assert np.flatnonzero(outline(shape, 2)[0]).tolist() == [2, 3, 5, 6]


def test_pictures_stand_in_the_middle_of_their_cells_below_the_head():
    red = Cell("red", np.full((10, 20, 3), (255, 0, 0), np.uint8), (255, 255, 255))
    sheet = np.asarray(contact_sheet([red] * 5, side=40, letters=30, font=11, head=7))
    rows, columns = np.nonzero((sheet == (255, 0, 0)).all(-1))
    assert len(rows) == 5 * 10 * 20
    assert (rows.min(), columns.min()) == (7 + GAP + 15, GAP + 10)
    assert tuple(sheet[0, 0]) == PAPER
    assert len(np.unique(columns)) == 4 * 20  # at least four cells stand side by side


def test_a_caption_is_cut_and_stands_below_its_picture_in_its_color():
    picture = np.zeros((40, 40, 3), np.uint8)
    long, short = (
        np.asarray(contact_sheet([Cell("x" * n, picture, (0, 255, 0))], side=40, letters=5, font=11))
        for n in (30, 5)
    )
    assert np.array_equal(long, short)
    assert np.nonzero((long[..., 1] > 200) & (long[..., 0] < 24))[0].min() > GAP + 40
