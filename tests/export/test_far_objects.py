"""Objects at survey coordinates, and very small and very large ones, as programs that are not ours read them."""

from pathlib import Path

import numpy as np
import pytest
import scipy
import trimesh

from lightprobe.core.config.export import ExportOptions
from lightprobe.export import export
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Similarity
from tests.export.glb_reader import Glb
from tests.export.toy_asset import toy_textures
from tests.shapes import sphere_mesh

BALL = sphere_mesh(4)
ACCURATE = 1e-4  # of the object's size
PLACES = {
    "near": Similarity(np.array([2.0, -1.0, 5.0]), 0.5),
    "survey": Similarity(np.array([345678.123, 5812345.678, 112.3]), 0.75),
    "tiny": Similarity(np.array([3e-4, -2e-4, 1e-4]), 1e-4),
    "huge": Similarity(np.array([-4e5, 2e5, 9e5]), 1e5),
    "tiny, far": Similarity(np.array([345678.123, 5812345.678, 112.3]), 1e-4),
}


@pytest.fixture(scope="module", params=PLACES)
def written(request, tmp_path_factory) -> tuple[Path, Similarity]:
    folder, similarity = tmp_path_factory.mktemp("far"), PLACES[request.param]
    export(
        Decomposition(Asset(BALL, toy_textures(8)), {}, similarity),
        folder,
        {},
        options=ExportOptions(usd=True),
    )
    return folder, similarity


def assert_there(points: np.ndarray, similarity: Similarity) -> None:
    """Check y-up points (N, 3) float64: each is one of the ball's vertices, and each vertex has one."""
    true = similarity.invert(BALL.vertices.numpy())
    found = np.stack([points[:, 0], -points[:, 2], points[:, 1]], 1)
    close = ACCURATE * similarity.scale
    for here, there in ((found, true), (true, found)):
        nearest = scipy.spatial.cKDTree((there - similarity.center) / similarity.scale)
        distance, _ = nearest.query((here - similarity.center) / similarity.scale)
        assert distance.max() * similarity.scale < close
    assert len(np.unique(found[:, 2])) > 500


def test_trimesh_reads_the_mesh_where_it_is(written):
    folder, similarity = written
    scene = trimesh.load_scene(folder / "mesh.glb", process=False)
    (node,) = scene.graph.nodes_geometry
    matrix, name = scene.graph[node]
    assert matrix.dtype == np.float64
    assert_there(trimesh.transform_points(scene.geometry[name].vertices, matrix), similarity)


def test_usd_s_library_reads_the_mesh_where_it_is(written):
    usd, geometry = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    folder, similarity = written
    stage = usd.Stage.Open(str(folder / "scene.usdz"))
    assert geometry.GetStageMetersPerUnit(stage) == 1
    mesh = geometry.Mesh.Get(stage, "/scene/object")
    points = np.array(mesh.GetPointsAttr().Get(), np.float64)
    matrix = np.array(mesh.ComputeLocalToWorldTransform(usd.TimeCode.Default()))
    assert_there(points @ matrix[:3, :3] + matrix[3, :3], similarity)
    box = geometry.BBoxCache(usd.TimeCode.Default(), ["default"]).ComputeWorldBound(mesh.GetPrim())
    middle = np.array(box.ComputeAlignedRange().GetMidpoint())
    x, y, z = similarity.center
    assert np.abs(middle - (x, z, -y)).max() < ACCURATE * similarity.scale


def test_vertices_are_told_from_the_object_s_middle(written):
    folder, similarity = written
    reach = np.abs(Glb((folder / "mesh.glb").read_bytes()).attribute("POSITION")).max()
    assert reach == pytest.approx(similarity.scale, rel=1e-3)
