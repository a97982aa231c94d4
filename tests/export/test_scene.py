"""The object with a light's map and lamps, as GLB, USD and USDZ."""

import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.core.config.export import ColorSpace, Dome, ExportOptions
from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import ConfigError, InputError, ResourceError
from lightprobe.export import SceneLight, export
from lightprobe.export.light_file import read_sources
from lightprobe.imaging import read_hdr
from lightprobe.light import equirect
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from tests.export.glb_reader import Glb
from tests.export.toy_asset import SIMILARITY, difficult_mesh, toy_textures

ROOT = Path(__file__).parents[2]
USD = ExportOptions(usd=True)
LAMPS = (
    LightSource((0.48, 0.6, 0.64), math.radians(3), (3.0, 2.4, 1.5)),
    LightSource((0.0, 0.0, -1.0), math.radians(0.265), (0.1, 0.2, 0.4)),
)


def sky() -> np.ndarray:
    """A map whose red rises with x, green with y and blue with z."""
    return (1 + 0.5 * equirect.directions(16).numpy()).astype(np.float32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    decomposition = Decomposition(
        Asset(difficult_mesh(), toy_textures(16)), {"r_0": Environment(torch.ones(6, 8, 8, 3))}, SIMILARITY
    )
    light = SceneLight(sky(), LAMPS)
    written = export(
        decomposition, folder, decomposition.lights, light=light, options=ExportOptions(64, usd=True)
    )
    assert sorted(written) == sorted(path for path in folder.rglob("*") if path.is_file())
    return folder


def test_all_maps_have_the_size_that_was_asked_for(folder):
    for name in ("light.exr", "light.hdr", "env/r_0.exr", "env/r_0.hdr"):
        assert read_hdr(folder / name).shape == (64, 128, 3)


def test_the_light_file_tells_importers_that_the_lamps_are_not_in_the_map(folder):
    sources, sun = read_sources(folder / "light.exr")
    assert sun is Sun.SEPARATE
    assert [source.irradiance for source in sources] == [lamp.irradiance for lamp in LAMPS]


@pytest.mark.parametrize("told", [[], "light.exr", None])
def test_a_light_file_whose_map_is_none_is_refused(tmp_path, told):
    kept = {"format": "lightprobe light", "version": 1, "sources": [], "map": told}
    (tmp_path / "light.light.json").write_text(json.dumps(kept))
    with pytest.raises(InputError, match="says what no light source can be"):
        read_sources(tmp_path / "light.exr")


def test_the_glb_has_a_node_for_each_lamp(folder):
    document = Glb((folder / "scene.glb").read_bytes()).document
    lights = document["extensions"]["KHR_lights_punctual"]["lights"]
    assert document["extensionsUsed"] == ["KHR_lights_punctual", "EXT_lights_image_based"]
    assert [light["type"] for light in lights] == ["directional"] * 2
    assert np.multiply(lights[0]["color"], lights[0]["intensity"]) == pytest.approx(LAMPS[0].irradiance)
    nodes = [document["nodes"][k] for k in document["scenes"][0]["nodes"]]
    assert ["mesh" in node for node in nodes] == [True, False, False]
    x, y, z, w = nodes[1]["rotation"]
    shines = -np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    assert shines == pytest.approx([-0.48, -0.64, 0.6])
    assert "extensions" not in Glb((folder / "mesh.glb").read_bytes()).document


@pytest.mark.skipif(
    shutil.which("node") is None or not (ROOT / "node_modules" / "gltf-validator").is_dir(),
    reason="needs node and `npm install --no-save gltf-validator`",
)
def test_khronos_validator_has_nothing_to_say_about_lamps(folder):
    command = ["node", "tools/validate_glb.mjs", str(folder / "scene.glb")]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("name", ["scene.usdc", "scene.usdz"])
@pytest.mark.parametrize("made", ["folder", "graded"])
def test_usd_s_own_validators_find_nothing(request, made, name):
    folder = request.getfixturevalue(made)
    usd, validation = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdValidation")
    registry = validation.ValidationRegistry()
    names = [one.name for one in registry.GetAllValidatorMetadata() if not one.isSuite]
    every = registry.GetOrLoadValidatorsByName(names)
    assert len(every) > 10
    stage = usd.Stage.Open(str(folder / name))
    found = validation.ValidationContext(every).Validate(stage)
    assert [error.GetErrorAsString() for error in found] == []


def test_usd_s_validators_find_what_is_wrong():
    usd, validation = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdValidation")
    registry = validation.ValidationRegistry()
    names = [one.name for one in registry.GetAllValidatorMetadata() if not one.isSuite]
    every = validation.ValidationContext(registry.GetOrLoadValidatorsByName(names))
    found = every.Validate(usd.Stage.CreateInMemory())
    assert found


def test_usd_has_the_mesh_the_material_and_the_lights(folder):
    geometry, lux, shade = (pytest.importorskip(f"pxr.{name}") for name in ("UsdGeom", "UsdLux", "UsdShade"))
    from pxr import Gf, Usd

    stage = Usd.Stage.Open(str(folder / "scene.usdz"))
    assert geometry.GetStageUpAxis(stage) == "Y"
    glb = Glb((folder / "mesh.glb").read_bytes())
    mesh = geometry.Mesh.Get(stage, "/scene/object")
    assert np.array_equal(np.array(mesh.GetPointsAttr().Get()), glb.attribute("POSITION"))
    st = np.array(geometry.PrimvarsAPI(mesh).GetPrimvar("st").Get())
    assert st[:, 1] == pytest.approx(1 - glb.attribute("TEXCOORD_0")[:, 1], abs=1e-6)
    material, _ = shade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    connected = {one.GetBaseName() for one in surface.GetInputs() if one.HasConnectedSource()}
    assert connected == {"diffuseColor", "metallic", "roughness", "normal", "occlusion"}
    distant = lux.DistantLight.Get(stage, "/scene/sun_1")
    irradiance = np.multiply(distant.GetColorAttr().Get(), distant.GetIntensityAttr().Get())
    assert irradiance == pytest.approx(LAMPS[0].irradiance)
    assert distant.GetAngleAttr().Get() == pytest.approx(6)
    matrix = distant.ComputeLocalToWorldTransform(Usd.TimeCode.Default())
    assert np.array(matrix.TransformDir(Gf.Vec3d(0, 0, -1))) == pytest.approx([-0.48, -0.64, 0.6], abs=1e-6)


def test_the_dome_shows_the_map_where_the_file_has_it(folder):
    """OpenEXR's latitude-longitude map: +z in the middle of the picture, +x at its left quarter, +y on top."""
    lux = pytest.importorskip("pxr.UsdLux")
    from pxr import Gf, Usd

    stage = Usd.Stage.Open(str(folder / "scene.usdc"))
    dome = lux.DomeLight.Get(stage, "/scene/environment")
    assert dome.GetTextureFormatAttr().Get() == "latlong"
    image = read_hdr(Path(dome.GetTextureFileAttr().Get().resolvedPath))
    matrix = dome.ComputeLocalToWorldTransform(Usd.TimeCode.Default())
    height, width = image.shape[:2]
    for row, column in ((20, 5), (40, 70), (5, 100), (60, 33)):
        latitude = math.pi * (0.5 - (row + 0.5) / height)
        longitude = math.pi * (1 - 2 * (column + 0.5) / width)
        across = math.cos(latitude)
        local = Gf.Vec3d(math.sin(longitude) * across, math.sin(latitude), math.cos(longitude) * across)
        x, y, z = matrix.TransformDir(local)
        assert image[row, column] == pytest.approx(1 + 0.5 * np.array([x, -z, y]), abs=0.02)  # user's axes


def test_without_usd_s_library_a_sentence_names_the_extra(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    with pytest.raises(ConfigError, match=r"lightprobe\[usd\]"):
        export(
            Decomposition(Asset(difficult_mesh(), toy_textures(8)), {}, SIMILARITY), tmp_path, {}, options=USD
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("raises", [False, True])
def test_a_package_that_usd_s_library_could_not_write_is_told(tmp_path, monkeypatch, raises):
    tf, utils = pytest.importorskip("pxr.Tf"), pytest.importorskip("pxr.UsdUtils")

    def package(stage, path):
        if raises:
            tf.RaiseRuntimeError("no room")
        return False

    monkeypatch.setattr(utils, "CreateNewUsdzPackage", package)
    with pytest.raises(ResourceError, match=r"could not write .*scene\.usdz; is there room on the disk"):
        export(
            Decomposition(Asset(difficult_mesh(), toy_textures(8)), {}, SIMILARITY), tmp_path, {}, options=USD
        )


@pytest.fixture(scope="module")
def graded(tmp_path_factory) -> Path:
    """The same scene with maps in ACEScg and a dome that names its pole."""
    folder = tmp_path_factory.mktemp("graded")
    asset = Asset(difficult_mesh(), toy_textures(8))
    lights = {"r_0": Environment(torch.ones(6, 8, 8, 3))}
    options = ExportOptions(color_space=ColorSpace.ACESCG, usd=True, dome=Dome.POLE_AXIS)
    export(
        Decomposition(asset, lights, SIMILARITY),
        folder,
        lights,
        light=SceneLight(sky(), LAMPS),
        options=options,
    )
    return folder


def test_maps_in_acescg_name_their_primaries_and_have_their_colours(graded):
    """As OpenEXR's library reads them, by the matrix that ACES' own configuration of OpenColorIO has."""
    import OpenEXR

    to_ap1 = [[0.613097, 0.339523, 0.047379], [0.070194, 0.916354, 0.013452], [0.020616, 0.109570, 0.869815]]
    for name in ("light.exr", "env/r_0.exr"):
        file = OpenEXR.File(str(graded / name))
        named = np.ravel(file.header()["chromaticities"])
        assert named == pytest.approx([0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767], abs=1e-6)
    pixels = OpenEXR.File(str(graded / "light.exr")).channels()["RGB"].pixels
    assert pixels == pytest.approx(sky() @ np.transpose(to_ap1), rel=1e-3)
    white = OpenEXR.File(str(graded / "env/r_0.exr")).channels()["RGB"].pixels
    assert white == pytest.approx(1, rel=1e-3)  # adapted
    for name in ("light.exr", "light.hdr"):  # Radiance stays sRGB's; ours reads both
        assert read_hdr(graded / name) == pytest.approx(sky(), rel=1e-2)


def test_a_dome_with_a_pole_axis_shows_the_map_where_a_turned_one_does(graded, folder):
    lux, usd = pytest.importorskip("pxr.UsdLux"), pytest.importorskip("pxr.Usd")
    stages = [usd.Stage.Open(str(place / "scene.usdc")) for place in (graded, folder)]
    dome = lux.DomeLight_1.Get(stages[0], "/scene/environment")
    assert (dome.GetPrim().GetTypeName(), dome.GetPoleAxisAttr().Get()) == ("DomeLight_1", "Y")
    assert dome.GetTextureFileAttr().GetColorSpace() == "lin_ap1_scene"
    turned = lux.DomeLight.Get(stages[1], "/scene/environment")
    assert turned.GetPrim().GetTypeName() == "DomeLight"
    # Y: the pole is local +y and the picture's middle local +z, as without the attribute, whatever the stage's axis
    here, there = (one.ComputeLocalToWorldTransform(usd.TimeCode.Default()) for one in (dome, turned))
    assert np.array(here) == pytest.approx(np.array(there))
    assert not turned.GetTextureFileAttr().HasColorSpace()


@pytest.mark.parametrize(("usd", "light"), [(False, True), (True, False)])
def test_a_dome_of_no_file_is_refused(usd, light):
    with pytest.raises(
        ConfigError, match=r"--dome DomeLight_1 is about the light in scene\.usdc; add --usd and"
    ):
        ExportOptions(usd=usd, dome=Dome.POLE_AXIS).check(light)
    ExportOptions(usd=True, dome=Dome.POLE_AXIS).check(light=True)
