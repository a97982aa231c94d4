"""How the service stands up to load: lost and wrong answers, seconds, memory, with hostile requests and killed workers.

    python -m benchmarks service RUN --scene SCENE --method probe-mlp --sources false --requests 10000
    python -m benchmarks service RUN --scene SCENE --requests 1000
    python -m benchmarks service RUN --scene SCENE --method probe-mlp --sources false --requests 10000 \\
        --hostile 0.2 --slow 4 --kill-every 20

RUN is a finished run of SCENE, whose photos are sent with their cameras, 320 pixels on the longer side. `lightprobe
serve` is started on a copy of the run with two workers; eight clients ask one request after the other. Each photo's map
is asked for alone first; a map under load must have the same pixels.

    lost      requests without an answer: the connection broke or timed out, or no sentence says why it failed
    wrong     maps that differ, and hostile requests that were not refused with a 4xx
    refused   honest requests that were refused or failed in a sentence; 429 is asked again after Retry-After
    seconds   of honest requests that got a map, the wait in the queue included
    memory    resident sizes of the server and its workers together, after a tenth of the requests and at the end

Hostile requests are truncated photos, a PNG that announces 60 000 x 60 000 pixels, damaged cameras, names that are
paths, other kinds of bodies, unknown fields, forms that end early, and photos that are too large. Slow clients send a
byte a second and never finish.
"""

import argparse
import base64
import io
import json
import os
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
from PIL import Image

from benchmarks import command_line
from lightprobe.core.memory import resident_bytes
from lightprobe.imaging import read_hdr
from lightprobe.scene import load_scene

_SIDE = 320  # pixels of the longer side of a photo
_PHOTOS = 12  # different ones
_PATIENCE = 120.0  # seconds after which a request counts as lost
_OBJECT = "measured"


@dataclass(frozen=True)
class Shot:
    """A photo with its camera as JSON, and the map that it gives alone."""

    name: str
    data: bytes
    camera: str
    map: bytes = b""


@dataclass
class Tally:
    """What came of the requests so far."""

    lost: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)
    hostile: Counter[int] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)
    done: int = 0
    memory_early: float = 0.0
    lock: threading.Lock = field(default_factory=threading.Lock)


def scene_shots(scene: Path) -> list[Shot]:
    """Return photos of a scene with their cameras, resized to 320 pixels on the longer side."""
    loaded = load_scene(scene)
    shots = []
    for photo in [*loaded.test, *loaded.train][:_PHOTOS]:
        image = Image.open(photo.image_path).convert("RGBA")
        scale = _SIDE / max(image.size)
        size = (round(image.width * scale), round(image.height * scale))
        buffer = io.BytesIO()
        image.resize(size, Image.Resampling.BICUBIC).save(buffer, "PNG")
        shots.append(Shot(photo.name, buffer.getvalue(), json.dumps(photo.camera.resized(*size).to_json())))
    return shots


def ask(client: httpx2.Client, shot: Shot, fields: dict[str, str]) -> httpx2.Response:
    """Return the answer to a photo."""
    return client.post(
        f"/objects/{_OBJECT}/predict",
        files={"photo": (f"{shot.name}.png", shot.data, "image/png")},
        data={"camera": shot.camera, "formats": "exr", **fields},
    )


def map_of(answer: httpx2.Response) -> bytes:
    """Return the map in an answer."""
    return base64.b64decode(answer.json()["files"][0]["base64"])


def same_map(one: bytes, other: bytes) -> bool:
    """Return whether two maps are equal, in their files or in their pixels."""
    if one == other:
        return True
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, name) for name in ("one.exr", "other.exr")]
        for path, data in zip(paths, (one, other), strict=True):
            path.write_bytes(data)
        return np.array_equal(read_hdr(paths[0]), read_hdr(paths[1]))


def bomb() -> bytes:
    """Return a PNG of a few bytes that announces 60 000 x 60 000 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def hostile(client: httpx2.Client, shot: Shot, draw: random.Random) -> httpx2.Response:
    """Return the answer to a request that must be refused."""
    path, photo, camera = f"/objects/{_OBJECT}/predict", ("a.png", shot.data), {"camera": shot.camera}
    early = b'--x\r\ncontent-disposition: form-data; name="photo"; filename="a.png"\r\n\r\n' + shot.data
    cameras = ["{", "[" * 5000, "{}", "null", '{"fx": 1e999}', "1" * 5000]
    names = ["..", "%2e%2e%2fetc", "..%2f..%2fetc%2fpasswd", "%00", "a%2fb", "x" * 3000]
    requests: tuple[tuple[str, dict[str, Any]], ...] = (
        (path, {"files": {"photo": ("a.png", shot.data[: draw.randrange(20, 2000)])}}),
        (path, {"files": {"photo": ("a.png", bomb())}, "data": camera}),
        (path, {"files": {"photo": photo}, "data": {"camera": draw.choice(cameras)}}),
        (f"/objects/{draw.choice(names)}/predict", {"files": {"photo": photo}}),
        (path, {"content": shot.data, "headers": {"content-type": "image/png"}}),
        (path, {"files": {"photo": photo, "else": ("x", b"x")}}),
        (path, {"content": early, "headers": {"content-type": "multipart/form-data; boundary=x"}}),
        (path, {"files": {"photo": ("a.png", draw.randbytes(500))}}),
    )
    if draw.random() < 0.01:
        return client.post(path, files={"photo": ("a.png", bytes(65 * 2**20))})
    address, request = draw.choice(requests)
    return client.post(address, **request)


def one_request(
    client: httpx2.Client, shot: Shot, number: int, options: argparse.Namespace, tally: Tally
) -> None:
    """Ask one request, honest or hostile by its number, and take down what came of it."""
    draw = random.Random(number)
    foe, attempts = draw.random() < options.hostile, 0
    try:
        while True:
            begin = time.perf_counter()
            answer = hostile(client, shot, draw) if foe else ask(client, shot, options.fields)
            seconds = time.perf_counter() - begin
            if answer.status_code != 429:
                break
            attempts += 1
            time.sleep(float(answer.headers["retry-after"]))
        status, sentence = answer.status_code, "" if answer.status_code == 200 else answer.json()["sentence"]
        same = not foe and status == 200 and same_map(map_of(answer), shot.map)
    except (httpx2.HTTPError, ValueError, KeyError) as error:
        with tally.lock:
            tally.lost.append(f"{number}: {type(error).__name__} {error}")
        return
    with tally.lock:
        tally.refused["429, asked again"] += attempts
        if foe:
            tally.hostile[status] += 1
            if not 400 <= status < 500:
                tally.wrong.append(f"{number}: a hostile request got {status} {sentence}")
        elif status != 200:
            tally.refused[f"{status} {re.sub(r'[0-9.]+', 'N', sentence)}"] += 1
        elif same:
            tally.seconds.append(seconds)
        else:
            tally.wrong.append(f"{number}: another map of {shot.name}")


def load(url: str, pid: int, shots: Sequence[Shot], options: argparse.Namespace) -> Tally:
    """Send all requests from as many clients as are wanted to the service of a process; return what came of them."""
    tally, numbers = Tally(), iter(range(options.requests))

    def work() -> None:
        with httpx2.Client(base_url=url, timeout=_PATIENCE) as client:
            while True:
                with tally.lock:
                    number = next(numbers, None)
                if number is None:
                    return
                one_request(client, shots[number % len(shots)], number, options, tally)
                with tally.lock:
                    tally.done += 1
                    if tally.done == max(options.requests // 10, 1):
                        tally.memory_early = memory(pid)

    threads = [threading.Thread(target=work) for _ in range(options.clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return tally


def children(pid: int) -> list[int]:
    """Return the processes that a process has started, on Linux."""
    files = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(number) for file in files for number in file.read_text().split()]


def memory(pid: int) -> float:
    """Return the resident size of a process and those that it has started, MiB."""
    return sum(resident_bytes(one) or 0 for one in (pid, *children(pid))) / 2**20


@contextmanager
def disturbances(url: str, pid: int, options: argparse.Namespace) -> Iterator[Counter[str]]:
    """Kill workers and keep slow connections open meanwhile; yield how often."""
    over, counts = threading.Event(), Counter[str]()

    def kill() -> None:
        while not over.wait(options.kill_every):
            workers = children(pid)
            if workers:
                os.kill(random.choice(workers), signal.SIGKILL)
                counts["killed"] += 1

    def dawdle() -> None:
        parts = httpx2.URL(url)
        head = (
            f"POST /objects/{_OBJECT}/predict HTTP/1.1\r\nhost: {parts.host}\r\ncontent-length: 100000\r\n"
            "content-type: multipart/form-data; boundary=x\r\n\r\n--x\r\n"
        ).encode()
        while not over.is_set():
            try:
                with socket.create_connection((parts.host, parts.port), timeout=5) as line:
                    counts["slow"] += 1
                    for at in range(len(head) + 10**5):
                        line.sendall(head[at : at + 1] or b"x")
                        if over.wait(1.0 if at >= len(head) else 0.02):
                            return
            except OSError:
                continue  # given up by the server, as it should be

    tasks = [dawdle] * options.slow + ([kill] if options.kill_every > 0 else [])
    threads = [threading.Thread(target=task, daemon=True) for task in tasks]
    for thread in threads:
        thread.start()
    try:
        yield counts
    finally:
        over.set()
        for thread in threads:
            thread.join(5)


@contextmanager
def service(run: Path, options: argparse.Namespace) -> Iterator[tuple[str, int]]:
    """Yield address and process of a service of a copy of a run, once a worker can be asked."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "runs" / _OBJECT
        left = shutil.ignore_patterns("checkpoints", "report", "oracle", "predictions")
        shutil.copytree(run, target, ignore=left)
        command = [sys.executable, "-m", "lightprobe", "serve", str(target.parent), "--port", "0"]
        command += ["--log-level", "warning"]
        command += ["--workers", str(options.workers), "--deadline", str(options.deadline)]
        with open(options.log, "w") as log:
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        assert process.stdout is not None
        url = process.stdout.readline().split()[1]
        try:
            while httpx2.get(f"{url}ready", timeout=60).status_code != 200:
                time.sleep(0.2)
            yield url, process.pid
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(options.deadline + 30)


def report(
    tally: Tally, counts: Counter[str], end: float, seconds: float, options: argparse.Namespace
) -> str:
    """Return the results as lines; end: MiB after the last request."""
    p50, p95 = np.percentile(tally.seconds, [50, 95]) if tally.seconds else (np.nan, np.nan)
    growth = 100 * (end / tally.memory_early - 1) if tally.memory_early else np.nan
    method = f"{options.method or 'default'}, sources {options.sources}"
    lines = [
        "| method | requests | maps | lost | wrong | p50 s | p95 s | maps per s | memory early, end MiB | growth |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        f"| {method} | {options.requests} | {len(tally.seconds)} | {len(tally.lost)} | {len(tally.wrong)} | {p50:.2f} | "
        f"{p95:.2f} | {len(tally.seconds) / seconds:.2f} | {tally.memory_early:.0f}, {end:.0f} | {growth:.1f} % |",
        f"refused: {dict(tally.refused)}; hostile: {dict(tally.hostile)}; {dict(counts)}; {seconds:.0f} s",
    ]
    return "\n".join([*lines, *tally.lost[:10], *tally.wrong[:10]])


def main(words: Sequence[str]) -> None:
    """Measure, and print what came of it."""
    parser = command_line(__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--scene", type=Path, required=True)
    parser.add_argument("--method", default="")
    parser.add_argument("--sources", default="true", choices=["true", "false"])
    for name, value in (("requests", 1000), ("clients", 8), ("workers", 2), ("slow", 0)):
        parser.add_argument(f"--{name}", type=int, default=value)
    for name, number in (("hostile", 0.0), ("kill-every", 0.0), ("deadline", 60.0)):
        parser.add_argument(f"--{name}", type=float, default=number)
    parser.add_argument("--log", type=Path, default=Path(os.devnull), help="where the service's log goes")
    options = parser.parse_args(words)
    options.fields = {"sources": options.sources, **({"method": options.method} if options.method else {})}
    shots = scene_shots(options.scene)
    with service(options.run, options) as (url, pid):
        with httpx2.Client(base_url=url, timeout=_PATIENCE) as client:
            shots = [replace(shot, map=map_of(ask(client, shot, options.fields))) for shot in shots]
        begin = time.perf_counter()
        with disturbances(url, pid, options) as counts:
            tally = load(url, pid, shots, options)
        print(report(tally, counts, memory(pid), time.perf_counter() - begin, options))
        healthy = httpx2.get(f"{url}health", timeout=30).status_code == 200
        print(f"still up: {healthy}; load average {os.getloadavg()}")
