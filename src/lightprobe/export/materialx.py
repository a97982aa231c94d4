"""The object's material as MaterialX with OpenPBR's surface, which names the three pictures beside it.

A document of MaterialX 1.39: one `open_pbr_surface` whose base colour, roughness, metalness and normal come from
base_color.png (sRGB), orm.png and normal.png (green up), at texture coordinates with v upwards, as USD has them and as
readers of glTF make them. OpenPBR has no ambient occlusion: that part of orm.png is left out.
"""

from pathlib import Path
from typing import Any

from lightprobe.core.extras import extra_library
from lightprobe.core.files import write_bytes

NAME = "material.mtlx"


def check_materialx() -> None:
    """Raise `ConfigError` naming the extra when MaterialX's library is missing."""
    _library()


def write_materialx(folder: Path) -> Path:
    """Write material.mtlx beside the pictures in `folder`, atomically; return its path.

    Raises `ConfigError` without the extra `materialx`, `ResourceError` when the disk refuses.
    """
    mx = _library()
    document = mx.createDocument()
    graph = document.addNodeGraph("pictures")
    color = _picture(graph, "base_color", "color3", "srgb_texture")
    channels = graph.addNode("separate3", "orm_channels", "multioutput")
    channels.setConnectedNode("in", _picture(graph, "orm", "vector3"))
    normal = graph.addNode("normalmap", "bent_normal", "vector3")
    normal.setConnectedNode("in", _picture(graph, "normal", "vector3"))
    surface = document.addNode("open_pbr_surface", "surface", "surfaceshader")
    wires = [
        ("base_color", "color3", color, ""),
        ("specular_roughness", "float", channels, "outy"),
        ("base_metalness", "float", channels, "outz"),
        ("geometry_normal", "vector3", normal, ""),
    ]
    for name, kind, node, channel in wires:
        output = graph.addOutput(f"{name}_out", kind)
        output.setConnectedNode(node)
        if channel:
            output.setOutputString(channel)
        surface.addInput(name, kind).setConnectedOutput(output)
    document.addMaterialNode("object", surface)
    write_bytes(folder / NAME, mx.writeToXmlString(document).encode())
    return folder / NAME


def _picture(graph: Any, name: str, kind: str, color_space: str = "") -> Any:
    node = graph.addNode("image", name, kind)
    node.setInputValue("file", f"{name}.png", "filename")
    for axis in ("uaddressmode", "vaddressmode"):
        node.setInputValue(axis, "clamp")
    if color_space:
        node.getInput("file").setColorSpace(color_space)
    return node


def _library() -> Any:
    return extra_library("MaterialX", "Writing MaterialX", "materialx")
