"""The pictures of docs/conventions.md, drawn with the project's own cameras, cubemaps and conversions.

python docs/make_pictures.py            # writes docs/pictures/*.png
python docs/make_pictures.py FOLDER     # writes them there
"""

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from lightprobe.evaluation.relighting import look_at
from lightprobe.export.gltf_mesh import to_y_up
from lightprobe.light import cubemap, equirect
from lightprobe.scene.camera import Camera

FOLDER = Path(__file__).parent / "pictures"
FACES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
TINTS = [(214, 69, 65), (240, 178, 175), (58, 157, 86), (168, 216, 182), (56, 103, 214), (172, 192, 240)]
AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
INK, GREY, FINE = (40, 40, 40), (150, 150, 150), 2  # lines are drawn twice as large and reduced


def marked(directions: torch.Tensor) -> torch.Tensor:
    """Return colours (..., 3) in 0..255: of the axis nearest to each direction, darker along a grid of 15
    degrees.
    """
    nearest = (directions.double() @ torch.tensor(AXES).T).argmax(-1)
    elevation, azimuth = (
        directions[..., 2].clamp(-1, 1).asin(),
        torch.atan2(directions[..., 1], directions[..., 0]),
    )
    turns = torch.stack([elevation, azimuth], -1) / (np.pi / 12)
    line = ((turns - turns.round()).abs() < 0.03).any(-1)
    return torch.tensor(TINTS, dtype=torch.float32)[nearest] * torch.where(line, 0.8, 1.0)[..., None]


def canvas(width: int, height: int) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    """Return a white picture, `FINE` times as large as it will be, and what draws on it."""
    image = Image.new("RGB", (FINE * width, FINE * height), "white")
    return image, ImageDraw.Draw(image)


def finished(image: Image.Image) -> Image.Image:
    """Return the picture at its size, with few colours, as they need less space in a file."""
    small = image.resize((image.width // FINE, image.height // FINE), Image.Resampling.BOX)
    return small.quantize(128, dither=Image.Dither.NONE)


def write(
    draw: ImageDraw.ImageDraw, at: tuple[float, float], text: str, size: int = 15, color: tuple = INK
) -> None:
    """Write text around a point, in the units of the finished picture."""
    font = ImageFont.load_default(FINE * size)
    draw.multiline_text((FINE * at[0], FINE * at[1]), text, color, font, "mm", align="center")


def texture(colors: torch.Tensor, width: int, height: int) -> Image.Image:
    """Return colours (H, W, 3) as a picture, to be pasted onto a canvas."""
    pixels = Image.fromarray(colors.round().to(torch.uint8).numpy())
    return pixels.resize((FINE * width, FINE * height), Image.Resampling.BILINEAR)


def equirect_picture() -> Image.Image:
    """Return the marked environment as the file that `predict` writes shows it, axes named, u and v along its
    edges.
    """
    image, draw = canvas(640, 340)
    image.paste(texture(marked(equirect.directions(560)), 560, 280), (FINE * 40, FINE * 30))
    for name, axis in zip(FACES[:4], AXES, strict=False):
        u = (0.5 - np.arctan2(axis[1], axis[0]) / (2 * np.pi)) % 1
        for at in (0.03, 0.97) if u == 0 else (u,):
            write(draw, (40 + 560 * at, 170), name.lower(), 20)
    for y, name in ((44, "+z, the top row"), (296, "-z, the bottom row")):
        write(draw, (320, y), name, 15, (255, 255, 255) if y == 44 else INK)
    for share in (0, 0.25, 0.5, 0.75, 1):
        write(draw, (40 + 560 * share, 322), f"u = {share:g}", 13, GREY)
    for share in (0, 0.5, 1):
        write(draw, (20, 30 + 280 * share), f"v = {share:g}", 13, GREY)
    write(draw, (320, 14), "equirectangular map, seen from inside", 15)
    return finished(image)


def cubemap_picture() -> Image.Image:
    """Return the six faces of the marked environment as they are stored, row 0 on top."""
    image, draw = canvas(740, 178)
    faces = marked(cubemap.directions(256))
    for k, name in enumerate(FACES):
        left = 10 + 122 * k
        image.paste(texture(faces[k], 110, 110), (FINE * left, FINE * 34))
        write(draw, (left + 55, 18), f"{k}: {name}", 16)
        _, along, down = (part[k].round().long().tolist() for part in cubemap.frames(torch.device("cpu")))
        write(draw, (left + 55, 89), name.lower(), 20)
        write(draw, (left + 55, 160), f"right {signed(along)}, down {signed(down)}", 13, GREY)
    return finished(image)


def signed(axis: list[int]) -> str:
    """Return the name of an axis given as its vector."""
    k = int(np.abs(axis).argmax())
    return ("+" if axis[k] > 0 else "-") + "xyz"[k]


def axes_picture() -> Image.Image:
    """Return world, camera and glTF axes beside each other, seen by one of our own cameras."""
    image, draw = canvas(840, 290)
    world = _drawn(draw, 0, "world and environments:\nz up, as Blender")
    for axis, name, tint in zip(AXES[::2], "xyz", TINTS[::2], strict=True):
        world.arrow(np.zeros(3), axis, name, tint)
    pose = look_at(np.array([-0.8, -1.3, 0.35]), np.zeros(3), np.array([0, 0, 1.0]))
    seen = _drawn(draw, 330, "camera: OpenGL's axes,\nx right, y up, looks along -z")
    _photo_camera(seen, pose)
    gltf = _drawn(draw, 580, "mesh.glb and three.js: y up,\n(x, y, z) becomes (x, z, -y)")
    back = np.linalg.inv(to_y_up(np.eye(3)))  # where glTF's axes lie in the world
    for axis, name, tint in zip(np.eye(3) @ back, "xyz", TINTS[::2], strict=True):
        gltf.arrow(np.zeros(3), axis, name, tint)
    return finished(image)


class _drawn:  # noqa: N801 (a panel that is drawn on)
    """A panel of 260 x 290, in which a camera of ours sees the object as a circle, and arrows around it."""

    def __init__(self, draw: ImageDraw.ImageDraw, left: int, title: str):
        pose = look_at(np.array([4.2, -5.4, 2.9]), np.array([0, 0, 0.1]), np.array([0, 0, 1.0]))
        self.draw, self.camera = draw, Camera(pose, 640.0, 640.0, left + 130, 128, 840, 290)
        ring = self.points(
            0.62 * pose[:3, :2] @ np.stack([np.cos(t := np.linspace(0, 2 * np.pi, 90)), np.sin(t)])
        )
        draw.polygon(ring, fill=(238, 238, 238), outline=GREY)
        write(draw, (left + 130, 262), title, 14)

    def points(self, columns: np.ndarray) -> list[tuple[float, float]]:
        """Project points (3, N) to the canvas."""
        return [(FINE * x, FINE * y) for x, y, _ in self.camera.project(columns.T)]

    def line(self, start: np.ndarray, end: np.ndarray, tint: tuple, width: int = 2) -> None:
        """Draw a straight line between two points of space."""
        self.draw.line(self.points(np.stack([start, end], 1)), tint, FINE * width)

    def arrow(self, start: np.ndarray, along: np.ndarray, name: str, tint: tuple) -> None:
        """Draw an arrow and its name beyond its point."""
        self.line(start, start + along, tint, 3)
        (x, y), (bx, by), (lx, ly) = self.points(
            np.stack([start + along, start + 0.86 * along, start + 1.16 * along], 1)
        )
        side = np.array([-(y - by), x - bx]) * 0.45
        self.draw.polygon([(x, y), (bx + side[0], by + side[1]), (bx - side[0], by - side[1])], fill=tint)
        write(self.draw, (lx / FINE, ly / FINE), name, 17, tint)


def _photo_camera(panel: _drawn, pose: np.ndarray) -> None:
    right, up, backwards, place = pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3]
    corners = [
        place - 0.5 * backwards + a * 0.3 * right + b * 0.22 * up
        for a, b in ((-1, 1), (1, 1), (1, -1), (-1, -1))
    ]
    for k, corner in enumerate(corners):
        panel.line(place, corner, GREY, 1)
        panel.line(corner, corners[k - 1], GREY, 1)
    for axis, name, tint in zip((right, up, backwards), "xyz", TINTS[::2], strict=True):
        panel.arrow(place, 0.55 * axis, name, tint)


def pixels_picture() -> Image.Image:
    """Return the corner of a photo: row 0 on top, centres at halves."""
    image, draw = canvas(420, 250)
    side, left, top = 56, 120, 50
    for i in range(4):
        for j in range(5):
            box = [
                FINE * v
                for v in (left + side * j, top + side * i, left + side * (j + 1), top + side * (i + 1))
            ]
            if i < 3:
                draw.rectangle(box, outline=GREY, width=FINE)
                x, y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
                draw.ellipse([x - 5, y - 5, x + 5, y + 5], fill=TINTS[0] if (i, j) == (1, 2) else INK)
    for j in range(5):
        write(draw, (left + side * (j + 0.5), 36), f"j = {j}", 13, GREY)
    for i in range(3):
        write(draw, (92, top + side * (i + 0.5)), f"i = {i}", 13, GREY)
    write(draw, (left + side * 2.5, top + side * 1.5 + 14), "(2.5, 1.5)", 12, TINTS[0])
    write(draw, (96, 40), "(0, 0)", 13)
    write(draw, (left + side * 2.5, 12), "x to the right, in pixels", 14)
    write(draw, (40, 140), "y\ndown", 14)
    write(draw, (210, 236), "pixel (column j, row i) has its centre at (j + 0.5, i + 0.5)", 13)
    return finished(image)


PICTURES = {
    "axes": axes_picture,
    "equirect": equirect_picture,
    "cubemap": cubemap_picture,
    "pixels": pixels_picture,
}


def main(folder: Path = FOLDER) -> None:
    """Write every picture."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        draw().save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
