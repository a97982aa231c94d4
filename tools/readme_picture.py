"""Make docs/demo.png, the README's picture, from the report of a run.

python tools/readme_picture.py runs/demo docs/demo.png
"""

import argparse
import base64
import html.parser
import io
from pathlib import Path

from PIL import Image

COLUMNS = 12  # pictures of one photo, in the order of the report
SIDE = 128
ROWS = 3


class _Pictures(html.parser.HTMLParser):
    """Collects the embedded pictures of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[Image.Image] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Decode the picture of an `img` element."""
        source = dict(attrs).get("src") or ""
        if tag == "img" and source.startswith("data:image/"):
            data = base64.b64decode(source.split(",", 1)[1])
            self.found.append(Image.open(io.BytesIO(data)).convert("RGB"))


def main() -> None:
    """Paste the first photos' pictures, a row each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("output", type=Path)
    arguments = parser.parse_args()
    pictures = _Pictures()
    pictures.feed((arguments.run / "report" / "index.html").read_text(encoding="utf-8"))
    sheet = Image.new("RGB", (COLUMNS * SIDE, ROWS * SIDE), "white")
    for number, picture in enumerate(pictures.found[: COLUMNS * ROWS]):
        picture.thumbnail((SIDE - 4, SIDE - 4))
        row, column = divmod(number, COLUMNS)
        left = column * SIDE + (SIDE - picture.width) // 2
        sheet.paste(picture, (left, row * SIDE + (SIDE - picture.height) // 2))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(arguments.output, optimize=True)


if __name__ == "__main__":
    main()
