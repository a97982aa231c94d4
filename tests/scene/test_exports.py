"""What other programs export, each in its own form: a few of the demo's cameras come back as they are.

The forms are those that these programs are known to write; docs/photos.md has them as a table.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from lightprobe.core.errors import InputError
from lightprobe.preparation.photos import source_photos
from lightprobe.scene.frame import Problems
from lightprobe.scene.inspect import inspect
from lightprobe.scene.loading import read_folder
from lightprobe.scene.plain_photos import inspect_plain, is_plain
from lightprobe.scene.unread_cameras import instead_of

DEMO = Path(__file__).parents[2] / "src/lightprobe/assets/demo/transforms_train.json"
SIZE = 40  # pixels of a side of the photos here


@dataclass(frozen=True)
class Shot:
    """One of the demo's cameras, in OpenGL's axes."""

    pose: np.ndarray  # (4, 4) camera to world

    @property
    def to_camera(self) -> np.ndarray:
        """The pose of OpenCV and COLMAP: world to camera, y down."""
        return np.linalg.inv(self.pose @ np.diag([1.0, -1.0, -1.0, 1.0]))

    @property
    def colmap(self) -> list[float]:
        """Quaternion w, x, y, z and translation."""
        x, y, z, w = Rotation.from_matrix(self.to_camera[:3, :3]).as_quat()
        return [float(value) for value in (w, x, y, z, *self.to_camera[:3, 3])]


_data = json.loads(DEMO.read_text())
ANGLE = _data["camera_angle_x"]
FOCAL = 0.5 * SIZE / np.tan(ANGLE / 2)
SHOTS = [Shot(np.array(frame["transform_matrix"])) for frame in _data["frames"][:6]]
LENS = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": SIZE / 2, "cy": SIZE / 2, "w": SIZE, "h": SIZE}
FLAT = {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}


def photos(folder: Path, pattern: str, *, scale: int = 1, first: int = 0) -> list[str]:
    """Write a photo for each camera; return the names, counted from `first`."""
    names = [pattern.format(number) for number in range(first, first + len(SHOTS))]
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (SIZE // scale,) * 2, (90, 90, 90)).save(folder / name)
    return names


def transforms(root, names, *, top, own=lambda number: {}, name="transforms.json", encoding="utf-8"):
    frames = [
        {"file_path": file, "transform_matrix": shot.pose.tolist(), **own(number)}
        for number, (file, shot) in enumerate(zip(names, SHOTS, strict=True))
    ]
    (root / name).write_text(json.dumps({**top, "frames": frames}, indent=4), encoding=encoding)


def colmap_text(
    folder, names, *, model="PINHOLE", each=False, end="\n", points="", encoding="utf-8", header=True
):
    """Write a model as text; `each`: a camera for every photo."""
    folder.mkdir(parents=True, exist_ok=True)
    focal = [FOCAL] if model.startswith("SIMPLE") else [FOCAL, FOCAL]
    rest = {"OPENCV": [0.0] * 4, "SIMPLE_RADIAL": [0.0]}.get(model, [])
    values = " ".join(map(str, [*focal, SIZE / 2, SIZE / 2, *rest]))
    count = len(names) if each else 1
    cameras = ["# Camera list with one line of data per camera:"] if header else []
    cameras += [f"{number + 1} {model} {SIZE} {SIZE} {values}" for number in range(count)]
    images = ["# Image list with two lines of data per image:"] if header else []
    for number, (name, shot) in enumerate(zip(names, SHOTS, strict=True), start=1):
        images += [f"{number} {' '.join(map(str, shot.colmap))} {number if each else 1} {name}", points]
    for part, lines in (("cameras", cameras), ("images", images), ("points3D", ["# 3D points"])):
        (folder / f"{part}.txt").write_bytes((end.join(lines) + end).encode(encoding))


def colmap_binary(folder, names):
    folder.mkdir(parents=True, exist_ok=True)
    lens = struct.pack("<iiQQ4d", 1, 1, SIZE, SIZE, FOCAL, FOCAL, SIZE / 2, SIZE / 2)
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", 1) + lens)
    images = struct.pack("<Q", len(names))
    for number, (name, shot) in enumerate(zip(names, SHOTS, strict=True), start=1):
        images += struct.pack("<I7dI", number, *shot.colmap, 1) + name.encode() + b"\0"
        images += struct.pack("<QddQ", 1, 3.5, 4.5, 2**64 - 1)
    (folder / "images.bin").write_bytes(images)
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", 0))


def nerfstudio(root):
    """`ns-process-data images`: smaller photos beside, the applied transform, ids of COLMAP."""
    names = photos(root, "images/frame_{:05d}.png", first=1)
    photos(root, "images_2/frame_{:05d}.png", scale=2, first=1)
    applied = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-0.0, -1.0, -0.0, -0.0]]
    top = {
        **LENS,
        **FLAT,
        "camera_model": "OPENCV",
        "applied_transform": applied,
        "ply_file_path": "sparse_pc.ply",
    }
    transforms(root, names, top=top, own=lambda number: {"colmap_im_id": number + 1})


def nerfstudio_colmap(root):
    """The same folder without transforms.json: the model is in colmap/sparse/0."""
    colmap_binary(
        root / "colmap/sparse/0", [Path(name).name for name in photos(root, "images/frame_{:05d}.jpg")]
    )


def instant_ngp(root):
    """colmap2nerf.py: angles and focal lengths, its own box, sharpness of each photo."""
    names = [f"./{name}" for name in photos(root, "images/{:04d}.jpg")]
    top = {
        "camera_angle_x": ANGLE,
        "camera_angle_y": ANGLE,
        **LENS,
        **FLAT,
        "k3": 0,
        "k4": 0,
        "is_fisheye": False,
    }
    transforms(root, names, top={**top, "aabb_scale": 32}, own=lambda number: {"sharpness": 31.2 + number})


def instant_ngp_elsewhere(root):
    """colmap2nerf.py started in another folder: paths from there."""
    names = [f"./data/nerf/cup/{name}" for name in photos(root, "images/{:04d}.jpg")]
    transforms(root, names, top={**LENS, **FLAT, "aabb_scale": 4})


def colmap_automatic(root):
    """The mapper's binary model; names with folders and spaces."""
    names = photos(root / "images", "day 1/IMG {:03d}.jpg")
    colmap_binary(root / "sparse/0", names)
    (root / "database.db").write_bytes(b"SQLite format 3\0")


def colmap_undistorted(root):
    """`colmap image_undistorter`, as gaussian-splatting's convert.py leaves it: the distorted model is another."""
    names = photos(root / "images", "{:03d}.jpg")
    photos(root / "input", "{:03d}.jpg")
    colmap_binary(root / "sparse/0", names)
    colmap_text(root / "distorted/sparse/0", names, model="OPENCV")


def metashape(root):
    """Export Cameras, Colmap: text without points of the photos, one camera for all."""
    colmap_text(root / "sparse/0", photos(root / "images", "DSC{:05d}.JPG"), points="")


def metashape_through_nerfstudio(root):
    """`ns-process-data metashape`: the lens in each frame."""
    names = photos(root, "images/frame_{:05d}.jpg")
    own = {**LENS, **FLAT, "k3": 0.0}
    applied = np.eye(4)[[1, 2, 0]].tolist()
    transforms(
        root, names, top={"camera_model": "OPENCV", "applied_transform": applied}, own=lambda number: own
    )


def reality_scan(root):
    """Registration as COLMAP: flat, a camera for each photo, Windows' line ends."""
    names = photos(root / "images", "_DSC{:04d}.jpg")
    colmap_text(root, names, each=True, end="\r\n", points="", header=False)


def polycam(root):
    """`ns-process-data polycam`: the lens in each frame, from ARKit."""
    names = [f"./{name}" for name in photos(root, "images/frame_{:05d}.jpg")]
    transforms(root, names, top={"camera_model": "OPENCV"}, own=lambda number: dict(LENS))


def kiri_engine(root):
    """Its camera pose export: transforms.json with the lens on top, and images/."""
    names = [f"./{name}" for name in photos(root, "images/{}.jpg", first=100)]
    transforms(root, names, top={**LENS, **FLAT, "camera_model": "OPENCV"})


def unity(root):
    """A script in C# on Windows: a byte order mark, backslashes, an angle in single precision."""
    names = [name.replace("/", "\\") for name in photos(root, "images/shot_{}.png")]
    transforms(root, names, top={"camera_angle_x": float(np.float32(ANGLE))}, encoding="utf-8-sig")


def blender_nerf(root):
    """BlenderNeRF: train photos with their ending, and the lens on top."""
    names = photos(root, "train/{:04d}.png", first=1)
    top = {"camera_angle_x": ANGLE, "camera_angle_y": ANGLE, **LENS, **FLAT, "aabb_scale": 4}
    transforms(root, names, top=top, name="transforms_train.json")


def nerf_synthetic(root):
    """The script that NeRF's own scenes were rendered with: no ending, `rotation` of the turntable."""
    names = [f"./train/r_{number}" for number in range(len(SHOTS))]
    photos(root, "train/r_{}.png")
    transforms(
        root,
        names,
        top={"camera_angle_x": ANGLE},
        own=lambda _: {"rotation": 0.0126},
        name="transforms_train.json",
    )


def record3d(root):
    """`ns-process-data record3d`: one lens, frames of a video."""
    names = photos(root, "images/frame_{:05d}.png", first=1)
    transforms(root, names, top={**LENS, "camera_model": "OPENCV"})


def meshroom(root):
    """`aliceVision_exportColmap`: text, with a camera for each photo and points."""
    names = photos(root / "images", "{}.jpg", first=1804289383)
    colmap_text(root / "sparse/0", names, model="OPENCV", each=True, points="10.5 11.5 1 12.5 13.5 -1")


def open_mvg(root):
    """`openMVG2Colmap`: a flat model of text, the photos put beside it."""
    colmap_text(root, photos(root / "images", "IMG_{}.JPG"), model="SIMPLE_RADIAL", points="10.5 11.5 1")


def odm(root):
    """`ns-process-data odm`: Brown's lens, on top."""
    names = photos(root, "images/frame_{:05d}.jpg")
    transforms(root, names, top={**LENS, **FLAT, "k3": 0.0, "camera_model": "OPENCV"})


def llff(root):
    """`imgs2poses.py`: rows of 3 x 5, down, right, backwards."""
    photos(root / "images", "image{:03d}.png")
    rows = []
    for shot in SHOTS:
        right, up, back, position = shot.pose[:3].T
        rows.append([*np.stack([-up, right, back, position, (SIZE, SIZE, FOCAL)], axis=1).ravel(), 1.0, 9.0])
    np.save(root / "poses_bounds.npy", np.array(rows))


EXPORTS = (
    nerfstudio,
    nerfstudio_colmap,
    instant_ngp,
    colmap_automatic,
    colmap_undistorted,
    metashape,
    metashape_through_nerfstudio,
    reality_scan,
    polycam,
    kiri_engine,
    unity,
    blender_nerf,
    nerf_synthetic,
    record3d,
    meshroom,
    open_mvg,
    odm,
    llff,
)


def check(root, *, tolerance=1e-12):
    """Assert that positions, directions and focal lengths are the demo's."""
    found = sorted(
        (photo for _, photo in read_folder(root, Problems()).all_photos()), key=lambda p: p.image_path
    )
    poses = np.array([photo.camera.camera_to_world for photo in found])
    np.testing.assert_allclose(poses, np.array([shot.pose for shot in SHOTS]), atol=1e-7)
    lenses = [(photo.camera.fx, photo.camera.fy, photo.camera.cx, photo.camera.cy) for photo in found]
    np.testing.assert_allclose(lenses, [(FOCAL, FOCAL, SIZE / 2, SIZE / 2)] * len(SHOTS), rtol=tolerance)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("export", EXPORTS, ids=lambda export: export.__name__)
def test_an_export_is_read_as_it_is(tmp_path, export):
    export(tmp_path)
    check(tmp_path, tolerance=1e-7 if export is unity else 1e-12)


@pytest.mark.filterwarnings("ignore:.*of another place")
def test_an_export_with_paths_from_another_folder(tmp_path):
    instant_ngp_elsewhere(tmp_path)
    check(tmp_path)


def test_blender_nerf_without_its_test_photos(tmp_path):
    """It writes cameras to test by, but renders nothing for them."""
    blender_nerf(tmp_path)
    transforms(tmp_path, [f"test/{n:04d}.png" for n in range(6)], top=LENS, name="transforms_test.json")
    with pytest.raises(
        InputError, match=r"transforms_test\.json names 6 photos, none of which exists, .* remove this"
    ):
        read_folder(tmp_path, Problems())
    (tmp_path / "transforms_test.json").unlink()
    check(tmp_path)


# Files that are not read

UNREAD = {
    "cameras.xml": (
        b'<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n  <chunk label="Chunk 1">',
        "in Metashape 2.2 or later choose File > Export > Export Cameras and there Colmap",
    ),
    "blocks.xml": (
        b"<BlocksExchange>",
        "export cameras and photos as a COLMAP model or with a transforms.json",
    ),
    "cup.psx": (b"<document/>", "in Metashape 2.2 or later"),
    "cup.csv": (
        b"#name,x,y,alt,heading,pitch,roll,f,px,py,k1\n",
        "in RealityScan export the registration as COLMAP",
    ),
    "IMG_1.xmp": (
        b'<x:xmpmeta xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#" xcr:Version="3"',
        "RealityScan",
    ),
    "cup.rcproj": (b"<RealityCaptureProject>", "in RealityScan"),
    "cameras.sfm": (b'{"version": ["1","2"], "views": [{"viewId": "12"}]}', "run `aliceVision_exportColmap"),
    "cup.mg": (b"{}", "run `aliceVision_exportColmap"),
    "sfm_data.json": (b'{"sfm_data_version": "0.3", "root_path": "/x"}', "run `openMVG_main_openMVG2Colmap"),
    "cameras.json": (
        b'[{"id": 0, "img_name": "00001", "rotation": []}]',
        "name the scene that these Gaussians",
    ),
    "bundle.out": (b"# Bundle file v0.3\n", "export cameras and photos"),
    "cup.nvm": (b"NVM_V3\n", "export cameras and photos"),
    "database.db": (b"SQLite format 3\0", "run `colmap mapper`"),
    "cup.abc": (b"\0", "export cameras and photos"),
}
OTHERS = {
    "notes.csv": (b"photo;lamp\n", "is no scene that is read; export cameras and photos"),
    "odd.xml": (b"<x/>", "is no scene that is read; export cameras and photos"),
    "point_cloud.ply": (b"ply\n", "holds a shape and no cameras; export cameras and photos"),
    "cup.zip": (b"PK", "is an archive; unpack it"),
    "transforms.json": (b"{}", "is one file of a scene; name the folder that holds it"),
    "images.bin": (b"", "is one file of a scene"),
    "poses_bounds.npy": (b"", "is one file of a scene"),
    "cup.txt": (b"x", "is not a folder."),
    "cup.json": (b"{}", "is no scene that is read"),
}


@pytest.mark.parametrize("name", [*UNREAD, *OTHERS])
def test_a_file_in_place_of_a_scene(tmp_path, name):
    content, said = {**UNREAD, **OTHERS}[name]
    (tmp_path / name).write_bytes(content)
    for read in (lambda path: read_folder(path, Problems()), source_photos):
        with pytest.raises(InputError) as caught:
            read(tmp_path / name)
        message = str(caught.value)
        assert message.startswith(str(tmp_path / name))
        assert said in message
        assert message.endswith(".")


@pytest.mark.parametrize("name", UNREAD)
def test_a_file_of_cameras_beside_photos(tmp_path, name):
    """Without photos there is no scene; with photos cameras can be found anew, which is said."""
    content, said = UNREAD[name]
    (tmp_path / name).write_bytes(content)
    (problem,) = inspect(tmp_path).problems
    assert f"is not a scene; {name} is of cameras in a form that is not read; " in problem
    assert said in problem
    photos(tmp_path, "images/{}.jpg")
    assert is_plain(tmp_path)
    hints = [hint for hint in inspect_plain(tmp_path).hints if said in hint]
    assert len(hints) == 1
    assert hints[0].endswith(", or let `prepare` find cameras anew.")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("IMG_1.xmp", b'<x:xmpmeta xmlns:crs="http://ns.adobe.com/camera-raw-settings/1.0/">'),
        ("lamps.csv", b"photo;lamp\n"),
        ("prices.json", b"{}"),
        ("Thumbs.db", b"\xd0\xcf\x11\xe0"),
        ("cup.glb", b"glTF"),
    ],
)
def test_other_files_beside_photos_are_no_cameras(tmp_path, name, content):
    photos(tmp_path, "images/{}.jpg")
    (tmp_path / name).write_bytes(content)
    assert not any(name in hint for hint in inspect_plain(tmp_path).hints)


def test_nothing_is_known_of_a_folder_or_of_another_file(tmp_path):
    assert instead_of(tmp_path / "cup.docx") is None
