"""The README's picture: a row per photo, every picture under its title."""

from PIL import Image

from readme_picture import SIDE, TITLE, by_photo, sheet


def test_each_photo_is_a_row_and_panoramas_are_twice_as_wide():
    square, wide = Image.new("RGB", (64, 64), "red"), Image.new("RGB", (64, 32), "blue")
    photos = by_photo([("photo", square), ("metallic", square), ("light", wide)] * 2)
    assert [[title for title, _ in photo] for photo in photos] == [["photo", "metallic", "light"]] * 2
    page = sheet(photos)
    assert page.size == (3 * SIDE, TITLE + 2 * SIDE)
    for row in range(2):
        middle = TITLE + row * SIDE + SIDE // 2
        assert page.getpixel((SIDE // 2, middle)) == (255, 0, 0)
        assert page.getpixel((2 * SIDE, middle)) == (0, 0, 255)
    assert any(page.getpixel((x, TITLE // 2)) != (255, 255, 255) for x in range(SIDE))
