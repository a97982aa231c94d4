"""Make docs/demo.png, the README's picture, from the report of a run.

python tools/readme_picture.py runs/demo docs/demo.png
"""

import argparse
import base64
import html.parser
import io
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont, ImageOps

SIDE = 112  # pixels of a picture; panoramas are twice as wide
TITLE = 20  # pixels of the line above
ROWS = 3
LEFT_OUT = ("metallic",)  # to keep the rest readable on a page

Titled = tuple[str, Image.Image]


class _Pictures(html.parser.HTMLParser):
    """Collects the embedded pictures of a page with their titles."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[Titled] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Decode the picture of an `img` element."""
        named = dict(attrs)
        source, title = named.get("src") or "", named.get("alt") or ""
        if tag == "img" and source.startswith("data:image/"):
            data = base64.b64decode(source.split(",", 1)[1])
            self.found.append((title, Image.open(io.BytesIO(data)).convert("RGB")))


def by_photo(pictures: list[Titled]) -> list[list[Titled]]:
    """Return the pictures of each photo: a photo begins where the first title comes again."""
    photos: list[list[Titled]] = []
    for title, picture in pictures:
        if title == pictures[0][0]:
            photos.append([])
        photos[-1].append((title, picture))
    return photos


def sheet(photos: list[list[Titled]]) -> Image.Image:
    """Return a row of pictures per photo under a line of titles."""
    rows = [
        [(title, picture) for title, picture in photo if title not in LEFT_OUT] for photo in photos[:ROWS]
    ]
    widths = [SIDE * (2 if picture.width > 1.5 * picture.height else 1) for _, picture in rows[0]]
    page = Image.new("RGB", (sum(widths), TITLE + len(rows) * SIDE), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(12)
    left = 0
    for column, width in enumerate(widths):
        title = rows[0][column][0].replace("×", "x")  # which the font lacks
        draw.text((left + width / 2, TITLE / 2), title, fill="#333333", font=font, anchor="mm")
        for number, row in enumerate(rows):
            picture = ImageOps.contain(row[column][1], (width - 4, SIDE - 4))
            across, down = (width - picture.width) // 2, (SIDE - picture.height) // 2
            page.paste(picture, (left + across, TITLE + number * SIDE + down))
        left += width
    return page


def main() -> None:
    """Paste the first photos' pictures, a row each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("output", type=Path)
    arguments = parser.parse_args()
    pictures = _Pictures()
    pictures.feed((arguments.run / "report" / "index.html").read_text(encoding="utf-8"))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    sheet(by_photo(pictures.found)).save(arguments.output, optimize=True)


if __name__ == "__main__":
    main()
