"""The material as MaterialX, as its own library reads, validates and compiles it."""

import sys

import pytest

from lightprobe.core.config.export import ExportOptions
from lightprobe.core.errors import ConfigError
from lightprobe.export import export
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from tests.export.toy_asset import SIMILARITY, difficult_mesh, toy_textures

TOY = Decomposition(Asset(difficult_mesh(), toy_textures(8)), {}, SIMILARITY)
OPTIONS = ExportOptions(materialx=True)


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """The library, and the document with the definitions of its nodes, all of whose pictures are there."""
    mx = pytest.importorskip("MaterialX")
    folder = tmp_path_factory.mktemp("material")
    assert folder / "material.mtlx" in export(TOY, folder, {}, options=OPTIONS)
    nodes, document = mx.createDocument(), mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), nodes)
    mx.readFromXmlFile(document, str(folder / "material.mtlx"))
    document.setDataLibrary(nodes)
    for one in document.getNodeGraph("pictures").getNodes("image"):
        assert (folder / one.getInputValue("file")).is_file()
    return mx, document


def test_the_library_finds_the_document_sound(read):
    _, document = read
    assert document.validate() == (True, "")


def test_openpbr_has_what_gltf_s_material_has(read):
    _, document = read
    (material,) = document.getMaterialNodes()
    surface = material.getConnectedNode("surfaceshader")
    assert surface.getCategory() == "open_pbr_surface"
    found = {}
    for one in surface.getInputs():
        output = one.getConnectedOutput()
        node = output.getConnectedNode()
        picture = node if node.getCategory() == "image" else node.getConnectedNode("in")
        file = picture.getInput("file")
        found[one.getName()] = (
            file.getValue(),
            file.getColorSpace(),
            output.getOutputString(),
            node.getCategory(),
        )
        assert picture.getInputValue("uaddressmode") == "clamp"
    assert found == {
        "base_color": ("base_color.png", "srgb_texture", "", "image"),
        "specular_roughness": ("orm.png", "", "outy", "separate3"),
        "base_metalness": ("orm.png", "", "outz", "separate3"),
        "geometry_normal": ("normal.png", "", "", "normalmap"),
    }


def test_the_library_makes_a_shader_of_it(read):
    mx, document = read
    glsl, shaders = (pytest.importorskip(f"MaterialX.PyMaterialXGen{name}") for name in ("Glsl", "Shader"))
    generator = glsl.GlslShaderGenerator.create()
    context = shaders.GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    (element,) = shaders.findRenderableElements(document)
    code = generator.generate("object", element, context).getSourceCode("pixel")
    for name in ("base_color_file", "orm_file", "normal_file", "mx_normalmap"):
        assert name in code


def test_without_the_library_a_sentence_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "MaterialX", None)
    with pytest.raises(ConfigError, match=r"Writing MaterialX needs MaterialX.*lightprobe\[materialx\]"):
        export(TOY, tmp_path, {}, options=OPTIONS)
    assert not list(tmp_path.iterdir())
