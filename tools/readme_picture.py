"""Make docs/readme.jpg: a photo, the light predicted from it, and the photo with an object inserted.

    PYTHONPATH=. python tools/readme_picture.py runs/demo docs/readme.jpg

The photo is path-traced: the demo's coffee pot on matt ground in daylight, seen by a camera that no training photo has.
`lightprobe predict` finds its light, `lightprobe insert` puts a glazed pawn into it. Needs the development extra
`mitsuba` and an LLVM library newer than 15.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image, ImageDraw, ImageFont, ImageOps
from scipy.ndimage import gaussian_filter1d
from trimesh.visual.material import PBRMaterial

from lightprobe.cli.main import main as lightprobe
from lightprobe.evaluation.three_spheres import ThreeSpheres
from lightprobe.imaging import read_hdr, srgb_encode, write_png
from lightprobe.light.display import exposure, tone_mapped

SIDE = 512  # pixels of the photo, and across a panel
HEIGHT = SIDE // 2 + SIDE // 3  # of a panel: a map above three balls
CAPTION, GAP = 36, 12  # pixels of the line below a panel, and between panels
CAPTIONS = ("one photo of a known object", "the light predicted from it", "a pawn inserted under this light")
LIGHT, TURN, AZIMUTH = "immenstadter_horn", 105, 5.6  # columns the map is rolled by; radians of the camera
HEIGHTS = (0, 0.08, 0.13, 0.3, 0.6, 0.63, 0.67, 0.7, 1)  # of the pawn's outline below its head
RADII = (0.3, 0.3, 0.22, 0.13, 0.09, 0.19, 0.19, 0.09, 0)
PLACE = ("--at", "345,420", "--scale", "0.65")  # of the pawn


def make_photo(folder: Path) -> np.ndarray:
    """Write photo.png, its mask.png and camera.json into a folder; return the camera's pose (4, 4)."""
    from benchmarks.insertion_scenes import Case, camera_of
    from benchmarks.insertion_truth import photograph
    from demo_scene.render import Studio, View
    from demo_scene.textures import make_model

    pot = make_model(0)
    ground = float(pot.vertices[:, 2].min())
    camera = camera_of(Case("readme", LIGHT, TURN, AZIMUTH, 1.0), SIDE, ground)
    light = read_hdr(Path(__file__).parent / "demo_scene" / "hdri" / f"{LIGHT}.exr")[..., :3]
    photo = photograph(pot, None, np.roll(light, TURN, axis=1), camera, ground, samples=512)
    write_png(folder / "photo.png", photo * (0.4 / np.median(photo)))
    view = View(camera.camera_to_world, 2 * float(np.arctan(0.5 * SIDE / camera.fx)))
    alpha = Studio(pot, len(light)).photograph(view, SIDE, 64, seed=0)[..., 3:]
    write_png(folder / "mask.png", np.repeat(alpha, 3, axis=2), srgb=False)
    (folder / "camera.json").write_text(json.dumps(camera.to_json()))
    return camera.camera_to_world


def make_pawn(file: Path) -> None:
    """Write a pawn of dark red glaze as GLB."""
    height = np.linspace(0, 1, 200)
    body = gaussian_filter1d(np.interp(height, HEIGHTS, RADII), 2, mode="nearest")
    head = np.sqrt(np.clip(0.16**2 - (height - 0.84) ** 2, 0, None))
    outline = np.stack([np.where(height < 0.72, np.maximum(body, head), head), height], 1)
    pawn = trimesh.creation.revolve(np.concatenate([[[0, 0]], outline]), sections=96)
    pawn.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))  # glTF is y-up
    glaze = {"baseColorFactor": [0.28, 0.015, 0.02, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.12}
    pawn.visual = trimesh.visual.TextureVisuals(np.zeros((len(pawn.vertices), 2)), PBRMaterial(**glaze))
    pawn.export(file)


def light_panel(light: np.ndarray, pose: np.ndarray) -> Image.Image:
    """Return a map (H, 2H, 3) above a diffuse, a matte and a mirror ball in it, as a camera of pose (4, 4) sees them."""
    view, up = torch.from_numpy(pose[:3, 2].copy()), torch.from_numpy(pose[:3, 1].copy())
    balls = ThreeSpheres(view, up, side=128).picture(torch.from_numpy(light), SIDE // 3).numpy()
    panel = Image.new("RGB", (SIDE, HEIGHT), "black")
    shown = to_image(srgb_encode(tone_mapped(light, exposure(light))))
    panel.paste(shown.resize((SIDE, SIDE // 2), Image.Resampling.BICUBIC), (0, 0))
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
    parser.add_argument("run", help="run folder of `lightprobe demo`")
    parser.add_argument("picture", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        pose = make_photo(Path(folder))
        make_pawn(Path(folder, "pawn.glb"))
        photo, light, result = (f"{folder}/{name}" for name in ("photo.png", "light.exr", "inserted.png"))
        known = [given.run, photo, "--camera", f"{folder}/camera.json", "--mask", f"{folder}/mask.png"]
        lightprobe(["predict", *known, "--no-background", "-o", light])
        lightprobe(["insert", *known, "--object", f"{folder}/pawn.glb", *PLACE, "--env", light, "-o", result])
        with Image.open(photo) as before, Image.open(result) as after:
            panels = [
                before.convert("RGB"),
                light_panel(read_hdr(Path(light))[..., :3], pose),
                after.convert("RGB"),
            ]
        joined(panels).save(given.picture, quality=88)


if __name__ == "__main__":
    main()
