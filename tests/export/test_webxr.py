"""A light as WebXR's estimate, as three.js lights a surface by it."""

import json
import math
import shutil
import subprocess
from importlib import resources

import numpy as np
import pytest
import torch

from lightprobe.export.light_file import webxr_estimate
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource

LAMP = LightSource((0.48, 0.6, 0.64), math.radians(3), (3.0, 2.4, 1.5))
WEAK = LightSource((-0.8, 0.0, 0.6), math.radians(60), (0.3, 0.4, 0.6))  # so wide that nine harmonics show it
NORMALS = (
    (1, 0, 0),
    (-1, 0, 0),
    (0, 1, 0),
    (0, -1, 0),
    (0, 0, 1),
    (0, 0, -1),
    (0.48, 0.6, 0.64),
    (0.6, -0.64, 0.48),
)
# three.js' own estimate does the same with what a session gives it (XREstimatedLight).
LIT = """
import { readFileSync } from "node:fs";
import { DirectionalLight, LightProbe, Vector3 } from "./three.core.min.mjs";
const { estimate, normals } = JSON.parse(readFileSync(0, "utf8"));
const probe = new LightProbe(), lamp = new DirectionalLight();
probe.sh.fromArray(estimate.sphericalHarmonicsCoefficients);
lamp.position.copy(estimate.primaryLightDirection);
const { x, y, z } = estimate.primaryLightIntensity;
const lit = normals.map((normal) => {
  const n = new Vector3(...normal), around = probe.sh.getIrradianceAt(n, new Vector3());
  const facing = Math.max(n.dot(lamp.position), 0);
  return [around.x + facing * x, around.y + facing * y, around.z + facing * z];
});
console.log(JSON.stringify(lit));
"""


def sky() -> torch.Tensor:
    """A light (6, R, R, 3) whose red rises with x, green with y and blue with z."""
    return (1 + 0.5 * cubemap.directions(32)).float()


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_three_js_lights_surfaces_as_the_light_does(tmp_path):
    three = resources.files("lightprobe") / "view/static/vendor/three/three.core.min.js"
    (tmp_path / "three.core.min.mjs").write_bytes(three.read_bytes())
    (tmp_path / "lit.mjs").write_text(LIT)
    turned = [(x, z, -y) for x, y, z in NORMALS]  # as mesh.glb is
    given = json.dumps({"estimate": webxr_estimate(Environment(sky()), (LAMP, WEAK)), "normals": turned})
    done = subprocess.run(["node", "lit.mjs"], cwd=tmp_path, input=given, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    whole = sky() + LAMP.texels(32) + WEAK.texels(32)
    for normal, found in zip(NORMALS, json.loads(done.stdout), strict=True):
        facing = (cubemap.directions(32) @ torch.tensor(normal).float()).clamp(min=0)
        true = (whole * (facing * cubemap.solid_angles(32))[..., None]).sum((0, 1, 2))
        assert found == pytest.approx(true.tolist(), rel=0.02)


def test_without_sources_the_primary_light_is_black_and_overhead():
    estimate = webxr_estimate(Environment(sky()), ())
    assert estimate["primaryLightDirection"] == {"x": 0, "y": 1, "z": 0, "w": 0}
    assert estimate["primaryLightIntensity"] == {"x": 0, "y": 0, "z": 0, "w": 1}
    ambient = np.reshape(estimate["sphericalHarmonicsCoefficients"], (9, 3))[0] * 0.282095
    assert ambient == pytest.approx(1, rel=1e-3)
