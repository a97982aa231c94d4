"""The object and its light as a USD stage, and the same as one USDZ package.

The stage is y-up, in the user's units, which it takes for metres, with a mesh of one UsdPreviewSurface material, a
dome light with the map, and a distant light for each sun or lamp.

A dome of format `latlong` has its pole at local +y, the middle of the picture at local +z and its left quarter at
local +x (OpenEXR's latitude-longitude map). A map of this project has z on top, +x in the middle and +y at the left
quarter; turned y-up by (x, y, z) -> (x, z, -y) these are +y, +x and -z. So the dome is turned by 90 degrees about y,
which takes z to x and x to -z. `normalize` makes a distant light's intensity the irradiance of a surface that faces it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.config.export import ColorSpace, Dome, ExportOptions
from lightprobe.core.errors import ResourceError
from lightprobe.core.extras import extra_library
from lightprobe.export.glb import DirectionalLight
from lightprobe.export.gltf_mesh import GltfMesh
from lightprobe.export.pictures import NAMES

_DOME_TURN = 90.0  # degrees about y
_PURPOSE = "Writing USD"


def check_usd() -> None:
    """Raise `ConfigError` naming the extra when USD's library is missing."""
    _pxr("Usd")


def write_usd(
    folder: Path,
    mesh: GltfMesh,
    environment: Path | None,
    lights: Sequence[DirectionalLight],
    options: ExportOptions,
) -> list[Path]:
    """Write scene.usdc and scene.usdz into `folder`; return both.

    base_color.png, orm.png, normal.png and the map `environment` (.exr) have to stand in the folder already:
    the stage names them, the package holds them. Raises `ConfigError` without the extra `usd`, and
    `ResourceError` where a file cannot be written.
    """
    stage_file, package = folder / "scene.usdc", folder / "scene.usdz"
    usd, geometry, utils = _pxr("Usd"), _pxr("UsdGeom"), _pxr("UsdUtils")
    stage = usd.Stage.CreateNew(str(stage_file))
    geometry.SetStageUpAxis(stage, geometry.Tokens.y)
    geometry.SetStageMetersPerUnit(stage, 1.0)
    root = geometry.Xform.Define(stage, "/scene")
    stage.SetDefaultPrim(root.GetPrim())
    stage.GetRootLayer().documentation = "Made by lightprobe"
    _define_mesh(stage, mesh, "/scene/object")
    _define_material(stage, "/scene/object")
    if environment is not None:
        _define_dome(stage, environment.name, options)
    for k, light in enumerate(lights):
        _define_distant(stage, light, f"/scene/sun_{k + 1}")
    asset = _pxr("Sdf").AssetPath(str(stage_file))
    try:
        written = stage.GetRootLayer().Save() and utils.CreateNewUsdzPackage(asset, str(package))
    except _pxr("Tf").ErrorException:
        written = False
    if not written:
        words = f"USD could not write {stage_file} and {package.name}"
        raise ResourceError(f"{words}; is there room on the disk?")
    return [stage_file, package]


def _define_mesh(stage: Any, mesh: GltfMesh, path: str) -> None:
    geometry, vt, sdf, gf = _pxr("UsdGeom"), _pxr("Vt"), _pxr("Sdf"), _pxr("Gf")
    prim = geometry.Mesh.Define(stage, path)
    prim.CreatePointsAttr(vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.positions)))
    prim.CreateFaceVertexIndicesAttr(vt.IntArray.FromNumpy(mesh.faces.astype(np.int32).ravel()))
    prim.CreateFaceVertexCountsAttr(vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, np.int32)))
    prim.CreateNormalsAttr(vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.normals)))
    prim.SetNormalsInterpolation(geometry.Tokens.vertex)
    prim.CreateSubdivisionSchemeAttr(geometry.Tokens.none)
    low, high = (gf.Vec3f(*map(float, edge)) for edge in (mesh.positions.min(0), mesh.positions.max(0)))
    prim.CreateExtentAttr(vt.Vec3fArray([low, high]))
    prim.AddTranslateOp(geometry.XformOp.PrecisionDouble).Set(gf.Vec3d(*mesh.origin.tolist()))
    uv = np.stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]], 1)  # USD's v points up
    kind = sdf.ValueTypeNames.TexCoord2fArray
    coordinates = geometry.PrimvarsAPI(prim).CreatePrimvar("st", kind, geometry.Tokens.vertex)
    coordinates.Set(vt.Vec2fArray.FromNumpy(np.ascontiguousarray(uv, np.float32)))


def _define_material(stage: Any, mesh_path: str, path: str = "/scene/material") -> None:
    shade, sdf = _pxr("UsdShade"), _pxr("Sdf")
    kinds = sdf.ValueTypeNames
    material = shade.Material.Define(stage, path)
    surface = shade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    reader = shade.Shader.Define(stage, f"{path}/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", kinds.String).Set("st")
    st = reader.CreateOutput("result", kinds.Float2)
    textures = {name: _define_texture(stage, f"{path}/{name}", name, st) for name in NAMES}
    wires = [
        ("diffuseColor", kinds.Color3f, "base_color", "rgb", kinds.Float3),
        ("occlusion", kinds.Float, "orm", "r", kinds.Float),
        ("roughness", kinds.Float, "orm", "g", kinds.Float),
        ("metallic", kinds.Float, "orm", "b", kinds.Float),
        ("normal", kinds.Normal3f, "normal", "rgb", kinds.Float3),
    ]
    for target, kind, texture, channel, output in wires:
        made = textures[texture].CreateOutput(channel, output)
        surface.CreateInput(target, kind).ConnectToSource(made)
    surface.CreateOutput("surface", kinds.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    prim = stage.GetPrimAtPath(mesh_path)
    shade.MaterialBindingAPI.Apply(prim).Bind(material)


def _define_texture(stage: Any, path: str, name: str, st: Any) -> Any:
    shade, sdf, gf = _pxr("UsdShade"), _pxr("Sdf"), _pxr("Gf")
    kinds = sdf.ValueTypeNames
    texture = shade.Shader.Define(stage, path)
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", kinds.Asset).Set(sdf.AssetPath(f"./{name}.png"))
    texture.CreateInput("sourceColorSpace", kinds.Token).Set("sRGB" if name == "base_color" else "raw")
    for axis in ("wrapS", "wrapT"):
        texture.CreateInput(axis, kinds.Token).Set("clamp")
    if name == "normal":  # 0..1 is -1..1
        texture.CreateInput("scale", kinds.Float4).Set(gf.Vec4f(2, 2, 2, 1))
        texture.CreateInput("bias", kinds.Float4).Set(gf.Vec4f(-1, -1, -1, 0))
    texture.CreateInput("st", kinds.Float2).ConnectToSource(st)
    return texture


def _define_dome(stage: Any, file: str, options: ExportOptions) -> None:
    lux, sdf = _pxr("UsdLux"), _pxr("Sdf")
    dome = getattr(lux, options.dome.value).Define(stage, "/scene/environment")
    if options.dome is Dome.POLE_AXIS:
        dome.CreatePoleAxisAttr(lux.Tokens.Y)  # whichever axis is up where the stage is referred to
    texture = dome.CreateTextureFileAttr(sdf.AssetPath(f"./{file}"))
    if options.color_space is ColorSpace.ACESCG:
        texture.SetColorSpace(_pxr("Gf").ColorSpaceNames.LinearAP1)
    dome.CreateTextureFormatAttr(lux.Tokens.latlong)
    dome.CreateIntensityAttr(1.0)
    dome.AddRotateYOp().Set(_DOME_TURN)


def _define_distant(stage: Any, light: DirectionalLight, path: str) -> None:
    lux, gf = _pxr("UsdLux"), _pxr("Gf")
    distant = lux.DistantLight.Define(stage, path)
    distant.CreateAngleAttr(light.angle)
    distant.CreateColorAttr(gf.Vec3f(*light.color))
    distant.CreateIntensityAttr(light.intensity)
    distant.CreateNormalizeAttr(True)
    x, y, z, w = light.quaternion()
    distant.AddOrientOp().Set(gf.Quatf(w, x, y, z))


def _pxr(module: str) -> Any:
    return extra_library(f"pxr.{module}", _PURPOSE, "usd")
