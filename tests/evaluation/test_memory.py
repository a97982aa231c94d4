"""How much memory an evaluation of large photos takes, in a process of its own."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SIDE = 3464  # pixels: a photo of 12 megapixels

# One photo of the bundled scene, enlarged, against a ball of about half its object's size; five lights are
# rendered.
EVALUATION = """
import json, sys
from pathlib import Path
import numpy as np, torch
from PIL import Image
import lightprobe
from lightprobe.core.memory import peak_memory
from lightprobe.models import Decomposition
from lightprobe.evaluation import evaluate
from lightprobe.geometry.textures import Textures
from lightprobe.prediction import Method
from lightprobe.render.asset import Asset, textured_visibility
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Similarity
from lightprobe.scene.photo import Photo, Scene
from tests.shapes import sphere_mesh

folder, side = Path(sys.argv[1]), int(sys.argv[2])
small = load_scene(Path(lightprobe.__file__).parent / "assets" / "demo").test[0]
Image.open(small.image_path).resize((side, side)).save(folder / "large.png", compress_level=1)
photo = Photo("large", small.camera.resized(side, side), folder / "large.png")
mesh, up = sphere_mesh(4), torch.tensor([0.0, 0.0, 1.0]).expand(256, 256, 3).contiguous()
textures = Textures(torch.full((256, 256, 3), 0.5), torch.full((256, 256), 0.4), torch.zeros(256, 256), up)
ball = Asset(mesh, textures, textured_visibility(mesh, textures.flat()))
similarity = Similarity(np.zeros(3), 0.45)
scene = Scene(folder, "transforms", (photo,), (photo,), (), similarity)
found = evaluate(Decomposition(ball, {}, similarity), None, scene, methods=[Method.CONSTANT]).to_json()
print(json.dumps({"memory": peak_memory(), **found["mean"]}))
"""


@pytest.mark.long
def test_a_photo_of_twelve_megapixels_stays_below_four_gibibytes(tmp_path):
    command = [sys.executable, "-c", EVALUATION, str(tmp_path), str(SIDE)]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["memory"] < 3.5
    assert found["psnr"] > 5  # it was scored, not skipped
    assert found["psnr_unseen"] > 5
