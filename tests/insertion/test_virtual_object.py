import zlib

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.geometry.mesh import face_normals
from lightprobe.insertion.virtual_object import load_virtual_object
from tests.insertion.glbs import Writer, box, png, write


def test_a_box_is_read_z_up_with_flat_outward_normals(tmp_path):
    virtual = load_virtual_object(write(tmp_path / "box.glb", box()))
    assert virtual.vertices.amin(0).tolist() == [-1, -1, -1]
    assert virtual.vertices.amax(0).tolist() == [1, 1, 1]
    outward = torch.nn.functional.normalize(face_normals(virtual.vertices, virtual.faces), dim=1)
    torch.testing.assert_close(virtual.normals[virtual.faces[:, 0].long()], outward)
    middles = virtual.vertices[virtual.faces.long()].mean(1)
    assert ((outward * middles).sum(1) > 0).all()


def test_vertices_that_no_face_uses_are_no_part_of_an_object(tmp_path):
    made = Writer()
    corners = np.array([[0, 50, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    ups = made.array(np.eye(3, dtype=np.float32)[[1] * 4], "VEC3")
    attributes = {"POSITION": made.array(corners, "VEC3"), "NORMAL": ups}
    faces = made.array(np.array([[1], [3], [2]], np.uint32), "SCALAR")
    made.document["meshes"][0]["primitives"] = [{"attributes": attributes, "indices": faces}]
    virtual = load_virtual_object(write(tmp_path / "part.glb", made))
    assert len(virtual.vertices) == 3
    assert virtual.size.tolist() == [1, 1, 0]
    assert virtual.normals.tolist() == [[0, 0, 1]] * 3


def test_nodes_turn_scale_and_mirror(tmp_path):
    made = box()
    made.document["nodes"] = [
        {"children": [1], "translation": [0, 5, 0], "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]},
        {"mesh": 0, "scale": [3, 1, -1]},
    ]
    virtual = load_virtual_object(write(tmp_path / "box.glb", made))
    # x <- -y, y <- x, turned about z, then z up; where the box is does not matter
    assert np.allclose(virtual.vertices.amin(0), [-1, -1, -3], atol=1e-5)
    assert np.allclose(virtual.vertices.amax(0), [1, 1, 3], atol=1e-5)
    middles = virtual.vertices[virtual.faces.long()].mean(1) - virtual.vertices.mean(0)
    assert ((face_normals(virtual.vertices, virtual.faces) * middles).sum(1) > 0).all()
    assert ((virtual.normals[virtual.faces[:, 0].long()] * middles).sum(1) > 0).all()


def test_an_object_at_survey_coordinates_is_the_same_as_at_the_origin(tmp_path):
    near, far = (box(), box())
    far.document["nodes"][0]["translation"] = [345678.123, 112.3, -5812345.678]
    far.document["materials"] = near.document["materials"] = [{"doubleSided": True}]
    here, there = (
        load_virtual_object(write(tmp_path / f"{i}.glb", made)) for i, made in enumerate((near, far))
    )
    torch.testing.assert_close(there.vertices, here.vertices, atol=1e-6, rtol=0)
    torch.testing.assert_close(there.normals, here.normals)
    assert (there.twin == -1).all()  # a closed box has no other side to be seen


def textured(made: Writer, **material) -> Writer:
    texture = made.view(png((128, 255, 51)))
    made.document |= {
        "images": [{"bufferView": texture, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [material],
    }
    attributes = made.document["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = made.array(np.full((8, 2), 3.3, np.float32), "VEC2")
    return made


def test_textures_and_factors_multiply(tmp_path):
    pbr = {
        "baseColorTexture": {"index": 0},
        "metallicRoughnessTexture": {"index": 0},
        "metallicFactor": 0.5,
        "roughnessFactor": 0.25,
        "baseColorFactor": [1, 0.5, 1, 1],
    }
    made = textured(box(), pbrMetallicRoughness=pbr, emissiveTexture={"index": 0}, emissiveFactor=[2, 0, 0])
    virtual = load_virtual_object(write(tmp_path / "box.glb", made))
    one = virtual.materials[0].sample(virtual.uvs[:1], virtual.colors[:1], torch.full((1,), 1e-6))
    assert one.base_color[0].tolist() == pytest.approx([0.2158, 0.5, 0.0331], abs=1e-3)  # sRGB decoded
    assert float(one.roughness) == pytest.approx(0.25, abs=1e-3)  # green, linear
    assert float(one.metallic) == pytest.approx(0.1, abs=1e-3)  # blue
    assert one.emission[0].tolist() == pytest.approx([0.4317, 0, 0], abs=1e-3)


def test_an_open_two_sided_sheet_gets_its_other_side_and_a_solid_does_not(tmp_path):
    made = box()
    made.document["materials"][0]["doubleSided"] = True
    assert (load_virtual_object(write(tmp_path / "solid.glb", made)).twin == -1).all()
    made.document["accessors"][1]["count"] -= 3
    sheet = load_virtual_object(write(tmp_path / "sheet.glb", made))
    assert len(sheet.faces) == 22
    twins = face_normals(sheet.vertices, sheet.faces[sheet.twin])
    torch.testing.assert_close(twins, -face_normals(sheet.vertices, sheet.faces))


def changed(**entries):
    """Return a spoiler that replaces entries of the document."""
    return lambda made: made.document.update(entries)


def count(number: int, accessor: int = 1):
    return lambda made: made.document["accessors"][accessor].update(count=number)


def many_copies(made: Writer) -> None:
    made.document["nodes"] = [{"children": list(range(1, 90_000))}] + [{"mesh": 0}] * 89_999
    made.document["accessors"][1]["count"] = 36
    made.document["meshes"][0]["primitives"] *= 4


def not_a_number(made: Writer) -> None:
    made.binary[4:8] = b"\xff\xff\xff\x7f"


def out_of_range(made: Writer) -> None:
    made.binary[-4:] = b"\xff\0\0\0"


def beyond_the_file(made: Writer) -> None:
    made.document["bufferViews"][0]["byteLength"] = 10**6


def huge_texture(made: Writer) -> None:
    picture = bytearray(png((1, 2, 3)))
    picture[16:24] = (60_000).to_bytes(4, "big") * 2
    picture[29:33] = zlib.crc32(picture[12:29]).to_bytes(4, "big")  # of the changed header
    pbr = {"baseColorTexture": {"index": 0}}
    textured(made, pbrMetallicRoughness=pbr)
    made.document["images"][0]["bufferView"] = made.view(bytes(picture))


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (changed(buffers=[{"byteLength": 4, "uri": "../../etc/passwd"}]), "refers to other files"),
        (changed(images=[{"uri": "https://example.com/a.png"}]), "refers to other files"),
        (count(30_000_000), "10000000 faces"),
        (not_a_number, "NaN"),
        pytest.param(many_copies, "simplify", marks=pytest.mark.slow),
        (changed(nodes=[{"mesh": 0, "children": [0]}]), "no sound GLB"),
        (out_of_range, "no sound GLB"),
        (changed(nodes=[{}]), "no triangles"),
        (beyond_the_file, "no sound GLB"),
        (changed(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
        (huge_texture, "60000"),
        (changed(nodes=[{"mesh": 0, "scale": [1e300] * 3}]), "far"),
        (changed(nodes=[{"mesh": 0, "scale": [0] * 3}]), "no extent"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(tmp_path, spoil, word):
    made = box()
    spoil(made)
    with pytest.raises(InputError, match=word) as caught:
        load_virtual_object(write(tmp_path / "bad.glb", made))
    assert "\n" not in str(caught.value)
    assert "bad.glb" in str(caught.value)


@pytest.mark.parametrize("data", [b"", b"glTF", b"solid cube", b'{"asset": {}}', b"glTF" + bytes(40)])
def test_what_is_no_glb_is_refused(tmp_path, data):
    (tmp_path / "bad.glb").write_bytes(data)
    with pytest.raises(InputError, match=r"bad\.glb"):
        load_virtual_object(tmp_path / "bad.glb")


def test_a_document_cut_anywhere_is_refused(tmp_path):
    whole = box().bytes()
    for size in range(0, len(whole) - 1, 97):
        (tmp_path / "cut.glb").write_bytes(whole[:size])
        with pytest.raises(InputError):
            load_virtual_object(tmp_path / "cut.glb")


def test_an_extension_that_is_not_read_is_told(tmp_path):
    made = box()
    made.document["extensionsUsed"] = ["KHR_materials_unlit", "KHR_texture_transform"]
    (sentence,) = load_virtual_object(write(tmp_path / "box.glb", made)).warnings
    assert "KHR_materials_unlit" in sentence
    assert "KHR_texture_transform" not in sentence
