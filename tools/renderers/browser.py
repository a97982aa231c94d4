"""Render an exported object with three.js in a browser without a screen, on the software renderer."""

import base64
import json
import shutil
import subprocess
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_name("three_picture.html")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--disable-background-networking",
    "--no-first-run",
)
_KINDS = {".js": "text/javascript", ".html": "text/html", ".json": "application/json"}


def find_browser() -> str | None:
    """Return the path of Chromium, or None."""
    return next(filter(None, map(shutil.which, _BROWSERS)), None)


def three_picture(
    three: Path, mesh: Path, environment: Path, camera: dict[str, Any], output: Path, *, seconds: int = 240
) -> None:
    """Write what three.js, the npm package's folder `three`, makes of a mesh under a map, as PNG of 2 x 2
    samples.

    Raises `RuntimeError` where there is no browser, or no picture after `seconds`.
    """
    browser = find_browser()
    if browser is None:
        raise RuntimeError("three.js needs the browser Chromium.")
    given = json.dumps({"camera": camera, "samples": 2}).encode()
    files = {"/": PAGE, "/object.glb": mesh, "/map.exr": environment}
    server = _Server(files, {"/given.json": given}, three)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory() as profile:
        address = f"http://127.0.0.1:{server.server_port}/"
        process = subprocess.Popen(
            [browser, *_OPTIONS, f"--user-data-dir={profile}", address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            finished = server.answered.wait(seconds)
        finally:
            process.terminate()
            process.wait()
            server.shutdown()
            server.server_close()
    if not finished or server.picture is None:
        raise RuntimeError(
            f"three.js made no picture: {server.failure or f'nothing came within {seconds} s'}."
        )
    output.write_bytes(server.picture)


class _Server(ThreadingHTTPServer):
    """Serves the page and what it needs, and waits for the picture."""

    def __init__(self, files: dict[str, Path], contents: dict[str, bytes], three: Path) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files, self.contents, self.three = files, contents, three.resolve()
        self.answered = threading.Event()
        self.picture: bytes | None = None
        self.failure = ""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        content, kind = self._content()
        self.send_response(200 if content is not None else 404)
        self.send_header("Content-Type", kind)
        self.end_headers()
        self.wfile.write(content or b"")

    def _content(self) -> tuple[bytes | None, str]:
        if self.path in self.server.contents:
            return self.server.contents[self.path], "application/json"
        path = self.server.files.get(self.path)
        if path is None and self.path.startswith("/three/"):
            inside = (self.server.three / self.path.removeprefix("/three/")).resolve()
            path = inside if inside.is_relative_to(self.server.three) and inside.is_file() else None
        suffix = ".html" if self.path == "/" else Path(self.path).suffix
        return (None if path is None else path.read_bytes()), _KINDS.get(suffix, "application/octet-stream")

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        if self.path == "/picture":
            self.server.picture = base64.b64decode(body.partition(",")[2])
        else:
            self.server.failure = body
        self.send_response(204)
        self.end_headers()
        self.server.answered.set()

    def log_message(self, format: str, *values: object) -> None:
        """Say nothing of every request."""
