"""The known object of `tests.known_scene`, gathered again from its own truth maps."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.evaluation import oracle as oracle_module
from lightprobe.evaluation.oracle import can_be_oracle, oracle_decomposition
from lightprobe.geometry.mesh import Mesh
from lightprobe.imaging import write_exr, write_png
from lightprobe.models import Decomposition, ObjectVerdict
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Photo, Scene, Truth
from tests.known_scene import CPU, SIMILARITY, known_decomposition, write_photo

PLACES = (3, 1, 1), (-1, 3, 0.5), (-2, -2, -1.5), (1, -1, -3), (0.5, 0.5, 3)
AROUND = dict(zip(("a", "bb", "ccc", "dddd", "eeeee"), PLACES, strict=True))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder, decomposition = tmp_path_factory.mktemp("oracle"), known_decomposition()
    photos = tuple(write_photo(folder, name, decomposition, place) for name, place in AROUND.items())
    vertices = SIMILARITY.invert(decomposition.asset.mesh.vertices.numpy())
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in decomposition.asset.mesh.faces.tolist()]
    (folder / "mesh.obj").write_text("\n".join(lines))
    return Scene(folder, "transforms", photos[:1], photos, (), SIMILARITY)


@pytest.fixture(scope="module")
def oracle(scene, tmp_path_factory):
    # nothing of the run's own object is looked at
    wrong = dataclasses.replace(known_decomposition(), asset=None, verdict=ObjectVerdict(0.2, 5))
    return oracle_decomposition(wrong, scene, tmp_path_factory.mktemp("kept") / "asset.safetensors")


@pytest.mark.long
def test_the_true_object_is_found_again(oracle, scene):
    """RasterisedView from a camera that no photo has, in every channel that shading uses."""
    camera = dataclasses.replace(scene.test[0].camera).normalised(SIMILARITY)
    pose = camera.camera_to_world.copy()
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    pose[:3] = turn @ pose[:3]
    camera = dataclasses.replace(camera, camera_to_world=pose)
    mine, true = (
        rasterize_asset(asset, camera, CPU) for asset in (oracle.asset, known_decomposition().asset)
    )
    common = np.intersect1d(mine.pixel.numpy(), true.pixel.numpy())
    assert len(common) > 0.97 * len(true.pixel)
    a, b = (g.select(torch.from_numpy(np.searchsorted(g.pixel.numpy(), common))) for g in (mine, true))
    tolerances = {"base_color": 0.02, "roughness": 0.02, "metallic": 0.01, "position": 0.01}
    for name, tolerance in tolerances.items():
        assert float((getattr(a, name) - getattr(b, name)).abs().mean()) < tolerance, name
    angle = torch.rad2deg(torch.acos((a.normal * b.normal).sum(1).clamp(-1, 1)))
    assert float(angle.mean()) < 2
    assert oracle.asset.visibility is not None
    assert oracle.verdict is None  # there is no doubt about the true object


def test_it_is_made_once_and_kept(oracle, scene, tmp_path):
    kept = tmp_path / "asset.safetensors"
    oracle.asset.save(kept)
    (scene.root / "mesh.obj").rename(scene.root / "hidden.obj")
    try:
        assert not can_be_oracle(scene)
        with pytest.raises(InputError, match=r"no mesh\.obj"):
            oracle_decomposition(known_decomposition(), scene)
    finally:
        (scene.root / "hidden.obj").rename(scene.root / "mesh.obj")
    again = oracle_decomposition(known_decomposition(), scene, kept)
    assert torch.equal(again.asset.textures.base_color, oracle.asset.textures.base_color)
    assert list(again.lights) == ["light"]


def test_a_mesh_in_another_frame_or_none_at_all_is_noticed(scene, tmp_path):
    moved = dataclasses.replace(scene, root=tmp_path)
    (tmp_path / "mesh.obj").write_text("v 90 0 0\nv 90 1 0\nv 90 0 1\nf 1 2 3\n")
    with pytest.raises(InputError, match="one frame"):
        oracle_decomposition(known_decomposition(), moved)
    (tmp_path / "mesh.obj").write_text("v one two three\nf 1 1 1\n")
    with pytest.raises(InputError, match="cannot be read as a mesh"):
        oracle_decomposition(known_decomposition(), moved)


FLAT = Camera(
    np.eye(4) + np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2.0], [0, 0, 0, 0]]), 2, 2, 3, 2, 6, 4
)


def at(column: float, row: float) -> list[float]:
    """Return the point of the plane z = 0 that FLAT, two above it, shows at a place of its 6 x 4 pixels."""
    return [column - 3, 2 - row, 0]


@dataclasses.dataclass
class Spot:
    """A point of the plane, what photo and mesh say of its surroundings, and the weight that it deserves."""

    place: tuple[float, float] = (4.5, 1.5)  # the middle of pixel column 4, row 1
    # by row and column; elsewhere 1/2
    inverse: dict[tuple[int, int], float] = dataclasses.field(default_factory=dict)
    unknown: tuple[tuple[int, int], ...] = ()
    mapped: tuple[float, float, float] = (0.0, 0.0, 1.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    color: float = 14.0  # ten times the row and once the column
    unmixed: float = 1.0001
    cosine: float | None = None  # of normal and direction to the camera; by default the plane's


@pytest.mark.parametrize(
    "spot",
    [
        Spot(),
        Spot((4.5, 2.0), color=19.0),
        Spot((4.75, 1.5), color=14.25),
        Spot((4.75, 1.5), unknown=((1, 5),)),
        Spot((5.0, 1.5), unknown=((1, 5),), unmixed=0),  # half of it
        Spot(inverse={(1, 4): 0.5 * 1.009}, unmixed=1.0001),
        Spot(inverse={(1, 4): 0.5 * 0.988}, unmixed=0),
        Spot(inverse={(1, 4): 0.5 * 1.012}, unmixed=0),
        Spot(inverse={(0, 3): 0.5 * 0.992}),
        Spot(inverse={(0, 3): 0.5 * 0.988}, unmixed=0.0001),  # another surface beside it
        Spot(inverse={(1, 2): 0.5 * 0.95}),  # too far away to be mixed in
        Spot(mapped=(0.0, 0.6, 0.8), unmixed=0.8**8 + 0.0001),
        Spot(mapped=(0.0, 0.6, -0.8), unmixed=0.0001),
        Spot(normal=(0.0, 0.0, -1.0), cosine=0, unmixed=0.0001),
        Spot(normal=(1.0, 0.0, 0.0), mapped=(1.0, 0.0, 0.0), cosine=0),  # looks away from the camera's side
    ],
)
def test_a_photo_tells_of_the_points_that_it_shows_squarely(
    spot: Spot, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows, columns = torch.meshgrid(torch.arange(4.0), torch.arange(6.0), indexing="ij")
    maps = torch.zeros(4, 6, 8)
    maps[..., 0], maps[..., 3], maps[..., 4] = 10 * rows + columns, 0.25, 0.75
    maps[..., 5:] = torch.tensor(spot.mapped)
    known, inverse = torch.ones(4, 6, 1), torch.full((4, 6), 0.5)
    for place in spot.unknown:
        known[place], maps[place] = 0, 99
    for place, value in spot.inverse.items():
        inverse[place] = value
    monkeypatch.setattr(oracle_module, "_maps", lambda photo: (maps, known))
    point, normal = torch.tensor([at(*spot.place)]), torch.tensor([spot.normal])
    photo = Photo("flat", FLAT, Path("flat.png"))
    values, weight = oracle_module._seen_by(photo, View.of(FLAT, CPU), inverse, point, normal)
    plane = 2 / float((torch.tensor([0.0, 0, 2]) - point).norm())
    cosine = plane if spot.cosine is None else spot.cosine
    assert float(weight) == pytest.approx(cosine**2 * spot.unmixed, rel=1e-4, abs=1e-9)
    if spot.unmixed > 0:
        expected = [spot.color, 0, 0, 0.25, 0.75, *spot.mapped]
        assert values[0].tolist() == pytest.approx(expected, rel=1e-4, abs=1e-5)


def write_maps(folder: Path, normal: list[list[float]]) -> Truth:
    color, orm = np.array([[[0.2, 0.5, 0.05]] * 3]), np.array([[[0.9, 0.4, 0.75]] * 3])
    write_png(folder / "color.png", color, bits=16)
    write_png(folder / "orm.png", orm, srgb=False, bits=16)
    write_exr(folder / "normal.exr", np.array([normal], np.float32))
    return Truth(base_color=folder / "color.png", orm=folder / "orm.png", normal=folder / "normal.exr")


def test_maps_are_read_in_the_order_of_textures_and_known_where_there_is_a_normal(tmp_path: Path) -> None:
    """Normals of length .5 are of half a pixel of the object, and not believed."""
    truth = write_maps(tmp_path, [[0.0, 0.9, 1.2, 1.0], [0.3, 0.0, 0.4, 1.0], [0.0, -0.51, 0.0, 1.0]])
    camera = dataclasses.replace(FLAT, width=3, height=1)
    maps, known = oracle_module._maps(Photo("a", camera, tmp_path / "a.png", truth=truth))
    assert known[..., 0].tolist() == [[1, 0, 1]]
    material = [0.2, 0.5, 0.05, 0.4, 0.75]
    assert maps[0, 0].tolist() == pytest.approx([*material, 0, 0.6, 0.8], abs=1e-3)
    assert maps[0, 2].tolist() == pytest.approx([*material, 0, -1, 0], abs=1e-3)
    for missing in ("base_color", "orm", "normal"):
        with pytest.raises(ValueError, match="photo-b"):
            oracle_module._maps(
                Photo("photo-b", camera, tmp_path, truth=dataclasses.replace(truth, **{missing: None}))
            )
    with pytest.raises(InputError, match=r"color\.png has 3 x 1 pixels, but its photo 6 x 4"):
        oracle_module._maps(Photo("a", FLAT, tmp_path / "a.png", truth=truth))


def test_a_scene_brings_its_object_as_a_mesh_and_three_maps_of_a_test_photo(tmp_path: Path) -> None:
    truth = Truth(base_color=tmp_path, orm=tmp_path, normal=tmp_path)
    complete = Photo("a", FLAT, tmp_path / "a.png", truth=truth)
    less = [
        dataclasses.replace(complete, truth=dataclasses.replace(truth, **{name: None}))
        for name in ("base_color", "orm", "normal")
    ]
    whole = Scene(tmp_path, "transforms", (complete,), (*less, complete), (complete,), SIMILARITY)
    assert not can_be_oracle(whole)
    (tmp_path / "mesh.obj").write_text("v 0 0 0")
    assert can_be_oracle(whole)
    assert not can_be_oracle(dataclasses.replace(whole, test=tuple(less)))


LEANING, CHART, MIRRORED = (0.6, 0.0, 0.8), [[0, 0], [1, 0], [0, 1]], [[0, 0], [0, 1], [1, 0]]


@pytest.mark.parametrize(
    ("uvs", "n", "world", "local"),
    [
        (CHART, (0, 0, 1), (1.2, 0, 1.6), (0.6, 0, 0.8)),
        (CHART, (0, 0, 1), (0, 0.6, 0.8), (0, -0.6, 0.8)),  # v runs along y, the bitangent against it
        (MIRRORED, (0, 0, 1), (0.6, 0, 0.8), (0, -0.6, 0.8)),  # u along y, v along x
        (MIRRORED, (0, 0, 1), (0, 0.6, 0.8), (0.6, 0, 0.8)),
        (CHART, LEANING, (0, 0, 1), (-0.6, 0, 0.8)),
        (CHART, LEANING, LEANING, (0, 0, 1)),
        (CHART, LEANING, (0, -1, 0), (0, 1, 0)),
    ],
)
def test_normals_are_stored_along_u_against_v_and_outwards(
    uvs: list[list[float]], n: tuple[float, ...], world: tuple[float, ...], local: tuple[float, ...]
) -> None:
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    faces = torch.tensor([[0, 1, 2]], dtype=torch.int32)
    mesh = Mesh(corners, faces, torch.tensor(uvs, dtype=torch.float32), faces)
    middle = torch.full((1, 3), 1 / 3)
    smooth, normal = (torch.tensor([v], dtype=torch.float32) for v in (n, world))
    found = oracle_module._to_tangent_space(mesh, torch.tensor([0]), middle, smooth, normal)
    assert found[0].tolist() == pytest.approx(local, abs=1e-6)


def test_the_mesh_is_brought_into_the_normalised_frame_and_its_edges_are_short_and_sharp(
    tmp_path: Path,
) -> None:
    """Two rectangles meet at an edge along y: rough at 45 degrees, smooth at 35."""
    for degrees, sharp in ((45.0, True), (35.0, False)):
        x, z = 3.2 * math.cos(math.radians(degrees)), 3.2 * math.sin(math.radians(degrees))
        lines = ["v 7 0 1", "v 10.2 0 1", "v 10.2 3.2 1", "v 7 3.2 1"]
        lines += [f"v {7 - x} {y} {1 - z}" for y in (3.2, 0)]
        (tmp_path / "mesh.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4", "f 1 4 5", "f 1 5 6"]))
        scene = Scene(tmp_path, "transforms", (), (), (), Similarity(np.array([7.0, 0, 1]), 2.0))
        mesh = oracle_module._true_mesh(scene)
        assert mesh.vertices.amax(0).tolist() == pytest.approx([1.6, 1.6, 0])
        assert mesh.vertices.amin(0).tolist() == pytest.approx([-x / 2, 0, -z / 2])
        triangles = mesh.vertices[mesh.faces.long()]
        edges = (triangles - triangles.roll(1, 1)).norm(dim=2)
        assert 0.04 < float(edges.max()) <= 0.08
        flat = triangles[..., 2].abs().amax(1) < 1e-6
        corner_normals = mesh.normals()[mesh.normal_index.long()]
        fold = flat & (triangles[..., 0].amin(1) < 1e-6)
        bend = torch.rad2deg(torch.acos(corner_normals[fold][..., 2].clamp(-1, 1))).max()
        assert float(bend) == pytest.approx(0 if sharp else degrees / 2, abs=5)


def test_the_true_object_needs_no_calibration(oracle: Decomposition, scene: Scene, tmp_path: Path) -> None:
    kept = tmp_path / "asset.safetensors"
    oracle.asset.save(kept)
    calibrated = dataclasses.replace(known_decomposition(), trained=known_decomposition().asset)
    found = oracle_decomposition(calibrated, scene, kept)
    assert found.trained is None
    assert found.calibration is None
    assert found.similarity is calibrated.similarity
    kept.write_bytes(b"damaged")
    with pytest.raises(InputError, match="remove it, and it is made again"):
        oracle_decomposition(calibrated, scene, kept)
