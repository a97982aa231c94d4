"""Make docs/readme.jpg: a photo, the light predicted from it, and the photo with an object inserted.

    python tools/readme_picture.py runs/demo docs/readme.jpg

The photo is path-traced: the demo's coffee pot on matt ground in daylight, seen by a camera that no training photo has.
`lightprobe predict` finds its light, `lightprobe insert` puts a lantern into it. Needs the development extra `mitsuba`
and an LLVM library newer than 15; takes a minute.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont, ImageOps

from lightprobe.cli.main import main as lightprobe
from lightprobe.evaluation.three_spheres import ThreeSpheres
from lightprobe.imaging import read_hdr, srgb_encode
from lightprobe.light.display import exposure, tone_mapped

SIDE = 512  # pixels of the photo, and across a panel
HEIGHT = SIDE // 2 + SIDE // 3  # of a panel: a map above three balls
CAPTION, GAP = 36, 12  # pixels of the line below a panel, and between panels
CAPTIONS = (
    "one photo of a known object",
    "the light predicted from it",
    "a lantern inserted under this light",
)
LIGHT, TURN, AZIMUTH = "immenstadter_horn", 105, 5.6  # columns the map is rolled by; radians of the camera
PLACE = ("--at", "345,420", "--scale", "0.65")  # of the lantern


def make_photo(folder: Path, samples: int) -> np.ndarray:
    """Write photo.png, its mask.png and camera.json, and object.glb; return the camera's pose (4, 4)."""
    from demo_scene.files import read_exr, write_png
    from demo_scene.models import Subject
    from demo_scene.render import Studio, View
    from insertion.stills import Case, camera_of, glb, model_of
    from insertion.truth import photograph

    pot = model_of(Subject.COFFEE_POT)
    ground = min(float(part.vertices[:, 2].min()) for part in pot.parts)
    camera = camera_of(Case("readme", Subject.LANTERN, LIGHT, TURN, AZIMUTH, 1.0), SIDE, ground)
    light = read_exr(Path(__file__).parent / "demo_scene" / "hdri" / f"{LIGHT}.exr", "RGB")
    photo = photograph(pot, None, np.roll(light, TURN, axis=1), camera, ground, samples)
    write_png(folder / "photo.png", srgb_encode((photo * (0.4 / np.median(photo))).clip(0, 1)))
    view = View(camera.camera_to_world, 2 * float(np.arctan(0.5 * SIDE / camera.fx)))
    alpha = Studio(pot, len(light)).photograph(view, SIDE, 64, seed=0)[..., 3:]
    write_png(folder / "mask.png", np.repeat(alpha, 3, axis=2))
    (folder / "camera.json").write_text(json.dumps(camera.to_json()))
    (folder / "object.glb").write_bytes(glb(model_of(Subject.LANTERN)))
    return camera.camera_to_world


def light_panel(light: np.ndarray, pose: np.ndarray) -> Image.Image:
    """Return a map (H, 2H, 3) above a diffuse, a matte and a mirror ball in it, as a camera of pose (4, 4) sees them."""
    view, up = torch.from_numpy(pose[:3, 2].copy()), torch.from_numpy(pose[:3, 1].copy())
    balls = ThreeSpheres(view, up, side=128).picture(torch.from_numpy(light), SIDE // 3).numpy()
    panel = Image.new("RGB", (SIDE, HEIGHT), "black")
    map = to_image(srgb_encode(tone_mapped(light, exposure(light))))
    panel.paste(map.resize((SIDE, SIDE // 2), Image.Resampling.BICUBIC), (0, 0))
    panel.paste(to_image(balls), (1, SIDE // 2))
    return panel


def to_image(values: np.ndarray) -> Image.Image:
    """Return display-encoded values (H, W, 3) in [0, 1] as a picture."""
    return Image.fromarray((values.clip(0, 1) * 255 + 0.5).astype(np.uint8))


def joined(panels: list[Image.Image]) -> Image.Image:
    """Return the panels side by side, cut to one size, each above its caption."""
    page = Image.new("RGB", (len(panels) * (SIDE + GAP) - GAP, HEIGHT + CAPTION), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(20)
    for column, (panel, caption) in enumerate(zip(panels, CAPTIONS, strict=True)):
        left = column * (SIDE + GAP)
        page.paste(ImageOps.fit(panel, (SIDE, HEIGHT), centering=(0.5, 0.75)), (left, 0))
        draw.text((left + SIDE / 2, HEIGHT + CAPTION / 2), caption, fill="#333333", font=font, anchor="mm")
    return page


def main() -> None:
    """Photograph, predict, insert, and paste the three panels."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("run", type=Path, help="run folder of `lightprobe demo`")
    parser.add_argument("output", type=Path, help="the picture")
    parser.add_argument("--samples", type=int, default=512, help="paths of a pixel of the photo")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        pose = make_photo(Path(folder), given.samples)
        photo, light, result = (f"{folder}/{name}" for name in ("photo.png", "light.exr", "inserted.png"))
        known = (str(given.run), photo, "--camera", f"{folder}/camera.json", "--mask", f"{folder}/mask.png")
        thing = ("--object", f"{folder}/object.glb", "--env", light, *PLACE)
        for command in (
            ["predict", *known, "--no-background", "-o", light],
            ["insert", *known, *thing, "-o", result],
        ):
            if lightprobe(command) != 0:
                raise SystemExit(f"lightprobe {command[0]} failed.")
        with Image.open(photo) as before, Image.open(result) as after:
            panels = [
                before.convert("RGB"),
                light_panel(read_hdr(light)[..., :3], pose),
                after.convert("RGB"),
            ]
        joined(panels).save(given.output, quality=88)


if __name__ == "__main__":
    main()
