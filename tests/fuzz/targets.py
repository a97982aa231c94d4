"""Everything that reads a file which may come from elsewhere, with valid files for it, made by code."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks.record import Record
from lightprobe.core.checkpoint import Checkpoints, load_metadata, load_tensors, save_tensors
from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.export.light_file import read_sources, write_sources
from lightprobe.imaging import (
    extract_frames,
    focal_ratio,
    gravity,
    image_size,
    is_video,
    read_alpha,
    read_exif_ev100,
    read_ldr,
    read_mask,
    write_exr,
)
from lightprobe.imaging.video import measure_frames
from lightprobe.insertion.virtual_object import load_virtual_object
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource
from lightprobe.localization.views import KnownViews
from lightprobe.models.calibration import Calibration
from lightprobe.prediction import Predictor
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.options import store_hint, stored_hint
from lightprobe.preparation.output import finished
from lightprobe.report.report import read_report
from lightprobe.scene import read_camera
from lightprobe.scene.frame import Problems
from lightprobe.scene.lens import Lens
from lightprobe.scene.loading import read_folder
from lightprobe.view.watching import evaluation_of, newest_record, read_records, stage_lengths
from tests.benchmarks.records import record
from tests.fuzz import pictures, requests, servers
from tests.fuzz.edits import GLB, JSON, LINES, SAFETENSORS, WORDS, Form, with_checksums
from tests.imaging.videos import pan, write_video
from tests.insertion.glbs import box, png, write
from tests.report.pages import evaluated_run
from tests.scene.worlds import views, write_colmap, write_nerd, write_nerfstudio
from tests.service.serving import runs_folder
from tests.view.finished_run import add_model, finished_run

Read = Callable[[Path, Path], object]  # of the target's folder and of the file in it that was spoilt


@dataclass(frozen=True)
class Target:
    """A reader, and the files it is attacked through."""

    name: str
    make: Callable[[Path], object]  # writes the folder of valid files, made once for several targets
    pattern: str  # of that folder's files, those that are spoilt; several with blanks between
    read: Read
    form: Form | None = None  # what the files say, where that is spoilt as well as their bytes
    mend: Callable[[bytes], bytes] | None = None  # corrects checksums or lengths, for every other file

    def write(self, corpus: Path) -> tuple[str, ...]:
        """Make the valid files in `corpus`, unless they are there, and return the names of those to spoil."""
        folder = corpus / self.make.__name__
        if not folder.exists():
            folder.mkdir(parents=True)
            self.make(folder)
        found = [sorted(folder.glob(pattern)) for pattern in self.pattern.split()]
        return tuple(str(path.relative_to(folder)) for paths in found for path in paths)

    def copy(self, corpus: Path, folder: Path) -> None:
        """Copy the valid files to `folder`/NAME."""
        shutil.copytree(corpus / self.make.__name__, folder / self.name)


def _read_picture(root: Path, path: Path) -> None:
    image_size(path)
    color, alpha = read_ldr(path)
    for values in (color, read_mask(path), alpha if alpha is not None else np.zeros(1), read_alpha(path)):
        if values is not None and not np.isfinite(values).all():
            raise AssertionError("a picture was read with NaN or infinity")
    for fact in (focal_ratio, gravity, read_exif_ev100):
        fact(path)


def _read_map(root: Path, path: Path) -> None:
    try:
        _read_picture(root, path)
    finally:
        Environment.load(path)


def _read_scene(root: Path, path: Path) -> None:
    problems = Problems(collect=True)
    try:
        read_folder(root, problems)
    except InputError as error:
        problems.messages.append(str(error))
    wrong = [m for m in problems.messages if not m.isprintable() or not m.endswith(".") or len(m) > 1500]
    if wrong:
        raise AssertionError(f"no sentence: {wrong[0][:500]}")
    read_folder(root, Problems())


def _write_cameras(root: Path) -> None:
    write_nerfstudio(root, views(2))
    frames = json.loads((root / "transforms.json").read_text())
    camera = {"camera_to_world": frames["frames"][0]["transform_matrix"], "fx": 9, "fy": 9, "cx": 4, "cy": 4}
    camera |= {"width": 8, "height": 8, "lens": Lens((0.1, 0.01), (0.001, 0.0)).to_json()}
    scene = {"root": "/", "photos": {"train": {"a": {"image": "a.png", "camera": camera}}, "test": {}}}
    (root / "camera.json").write_text(json.dumps(camera))
    (root / "scene.json").write_text(json.dumps(scene))


def _nerfstudio(root: Path) -> None:
    write_nerfstudio(root, views(3))


def _colmap_text(root: Path) -> None:
    write_colmap(root, views(3), binary=False)


def _colmap_binary(root: Path) -> None:
    write_colmap(root, views(3), binary=True)


def _nerd(root: Path) -> None:
    write_nerd(root, views(3))


def _glbs(root: Path) -> None:
    write(root / "box.glb", box())
    textured = box()
    corners = len(textured.binary) and 8
    uvs = textured.array(np.random.default_rng(0).random((corners, 2)).astype(np.float32), "VEC2")
    textured.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uvs
    picture = textured.view(png((128, 255, 51)))
    textured.document |= {
        "images": [{"bufferView": picture, "mimeType": "image/png"}],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071}],
    }
    shift = {"KHR_texture_transform": {"offset": [0.1, 0.2], "scale": [2, 2], "rotation": 0.3}}
    textured.document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {
        "index": 0,
        "extensions": shift,
    }
    write(root / "textured.glb", textured)


def _videos(root: Path) -> None:
    frames = [frame[:48, :64] for frame in pan(4)]
    write_video(root / "a.mp4", frames)
    write_video(root / "a.mov", frames, codec="mjpeg", pixels="yuvj420p")
    write_video(root / "a.avi", frames)
    write_video(root / "a.mkv", frames, codec="ffv1")


def _read_video(root: Path, path: Path) -> None:
    if is_video(path):
        shutil.rmtree(root / "frames", ignore_errors=True)
        measure_frames(path)
        extract_frames(path, root / "frames", 2)


def _run(root: Path) -> None:
    run = finished_run(root)
    add_model(run)
    Calibration((1.0, 2.0, 0.5), "a grey card").save(run.calibration_file)
    (run.timings_file).write_text(
        json.dumps({"decompose": {"seconds": 3.5, "memory": 1.0, "finished": True}})
    )
    Checkpoints(run.path / "checkpoints").save(5, {"a": torch.ones(3)}, {"losses": [1.0, 2.0]})
    tensors = {
        "descriptor": torch.zeros(3, 64).half(),
        "place": torch.ones(3, 2),
        "size": torch.tensor([[640, 480], [640, 480]], dtype=torch.int32),
        "point": torch.rand(3, 3),
        "side": torch.eye(3)[:2],
        "photo": torch.tensor([0, 0, 1], dtype=torch.int32),
        "camera": torch.eye(4)[None].repeat(2, 1, 1),
        "tangent": torch.ones(2),
        "mask": torch.ones(2, 32, 32, dtype=torch.uint8),
        "mean": torch.ones(2, 3, 32, 32).half(),
        "lights": torch.ones(2, 6, 32, 32).half(),
        "edges": torch.ones(2, 2, 32, 32).half(),
        "focal": torch.tensor([1.2], dtype=torch.float64),
    }
    save_tensors(root / "views.safetensors", tensors, {"kind": "views"})
    _page_files(root)
    other = evaluated_run(root / "other", {"test_00": 30.0, "test_01": 28.0})
    shutil.copy(other.metrics_file, run.metrics_file)
    shutil.copytree(other.report_file.parent, run.report_file.parent)


def _read_run(root: Path, path: Path) -> None:
    run = RunFolder.open(root / "run")
    evaluation_of(run)
    for phase in ("decompose", "distill"):
        stage_lengths(run, phase)
    newest_record(run.metrics_log)
    read_records(run.metrics_log, 0)
    run.checkpoints.latest()
    read_report(run)
    Predictor.load(run.path)


def _read_tensors(root: Path, path: Path) -> None:
    load_tensors(path)
    load_metadata(path)
    KnownViews.load(path)


def _prepared(root: Path) -> None:
    write_nerfstudio(root, views(2))
    (root / ".prepare").mkdir()
    (root / "prepare.json").write_text(
        json.dumps({"key": "k", "warnings": ["one"], "mask_stability": {"view_00": 0.9}})
    )
    (root / ".prepare" / "written.json").write_text(json.dumps({"view_00": "0" * 32}))
    store_hint(root, "view_00", (1, 2, 30, 40))
    rng = np.random.default_rng(0)
    Cache(root / ".prepare").arrays("step", "k", lambda: {"values": rng.random((8, 8))})


def _read_prepared(root: Path, path: Path) -> None:
    stored_hint(root)
    finished(root, "k")
    Cache(root / ".prepare").arrays("step", "k", lambda: {"values": np.zeros(1)})


def _light_files(root: Path) -> None:
    source = LightSource((0.0, 0.6, 0.8), 0.01, (3.0, 2.0, 1.0), 0.1, 0.02)
    write_sources(root / "light.exr", 64, (source, source), Sun.SEPARATE)
    record("cup").write(root)


def _read_light_file(root: Path, path: Path) -> None:
    read_sources(root / "light.exr")


_RUN_JSON = (
    "run/config.json run/scene.json run/calibration.json run/timings.json run/metrics.json run/report/page.json "
    "run/model/config.json run/checkpoints/*/state.json"
)
_RUN_TENSORS = "run/mesh/*.safetensors run/model/*.safetensors run/checkpoints/*/tensors.safetensors"


def _service(root: Path) -> None:
    runs_folder(root / "runs")
    requests.write(root, requests.service_requests())


def _ask_service(root: Path, path: Path) -> None:
    token = servers.TOKEN if path.name.startswith("token-") else None
    servers.SERVERS.ask(servers.ServiceServer, root / "runs", path.read_bytes(), token)


def _page_files(root: Path) -> None:
    write_nerfstudio(root / "photos", views(2))
    (root / "photos" / "prepare.json").write_text("{}")
    write_exr(root / "sky.exr", np.full((8, 16, 3), 0.5, np.float32))
    write(root / "box.glb", box())
    data = (png((128, 255, 51)), (root / "sky.exr").read_bytes(), (root / "box.glb").read_bytes())
    requests.write(root, requests.page_requests(*data))


def _ask_page(root: Path, path: Path) -> None:
    token = "a-token" if path.name == "token.http" else None
    servers.SERVERS.ask(servers.PageServer, root, path.read_bytes(), token)


TARGETS = (
    Target("PNG", pictures.write_png, "*", _read_picture, mend=with_checksums),
    Target("JPEG", pictures.write_jpeg, "*", _read_picture),
    Target("WebP", pictures.write_webp, "*", _read_picture),
    Target("TIFF", pictures.write_tiff, "*", _read_picture),
    Target("HEIC, AVIF", pictures.write_heic, "*", _read_picture),
    Target("OpenEXR", pictures.write_exrs, "*", _read_map),
    Target("Radiance", pictures.write_radiances, "*", _read_map),
    Target("camera raw", pictures.write_raw, "*", _read_picture),
    Target("transforms", _nerfstudio, "transforms.json", _read_scene, JSON),
    Target("COLMAP text", _colmap_text, "sparse/0/cameras.txt sparse/0/images.txt", _read_scene, WORDS),
    Target("COLMAP binary", _colmap_binary, "sparse/0/cameras.bin sparse/0/images.bin", _read_scene),
    Target("NeRD arrays", _nerd, "poses_bounds.npy", _read_scene),
    Target(
        "camera files",
        _write_cameras,
        "camera.json scene.json transforms.json",
        lambda root, path: read_camera(path, root / "images" / "view_01.jpg"),
        JSON,
    ),
    Target("GLB", _glbs, "*.glb", lambda root, path: load_virtual_object(path), GLB),
    Target("video", _videos, "a.*", _read_video),
    Target("JSON of runs", _run, _RUN_JSON, _read_run, JSON),
    Target("metrics.jsonl", _run, "run/metrics.jsonl", _read_run, LINES),
    Target("tensors of runs", _run, _RUN_TENSORS, _read_run, SAFETENSORS),
    Target("safetensors", _run, "views.safetensors", _read_tensors, SAFETENSORS),
    Target(
        "files of prepare", _prepared, "prepare.json hint.json .prepare/written.json", _read_prepared, JSON
    ),
    Target("kept steps of prepare", _prepared, ".prepare/step.npz", _read_prepared),
    Target("light files", _light_files, "light.light.json", _read_light_file, JSON),
    Target("records", _light_files, "cup.json", lambda root, path: Record.read(path), JSON),
    Target("service requests", _service, "*.http", _ask_service, requests.REQUEST, requests.with_length),
    Target("page requests", _run, "*.http", _ask_page, requests.REQUEST, requests.with_length),
)
