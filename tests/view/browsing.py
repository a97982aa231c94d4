"""A server of the page in a thread, and Chromium in front of it."""

import contextlib
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import uvicorn

from lightprobe.view.app import create_app
from lightprobe.view.routes import Session
from lightprobe.view.server import open_address
from lightprobe.view.sources import Sources
from lightprobe.web.worker import WorkerProcess, worker_command

CHROMIUM = shutil.which("chromium")
# offline, and drawn by the processor: the same picture on every machine
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
PATIENCE = 120_000  # milliseconds that a test waits for one thing


class Running:
    """A server that can be stopped and started again at the same port."""

    def __init__(self, folders: list[Path], folder: Path):
        """Serve runs and scenes; files in `folder`."""
        command = worker_command("lightprobe.view.worker", "cpu")
        self._session = Session.within(folder, Sources.of(folders), lambda number: WorkerProcess(command))
        self.tasks = self._session.tasks
        self.port = 0
        self.start()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> None:
        """Answer from now on."""
        address = open_address(self.port, lan=False)
        self.port = address.port
        app = create_app(self._session, address.hosts, None)
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="error", lifespan="off", ws="none"))
        self._thread = threading.Thread(target=lambda: self._server.run(sockets=[address.listening]))
        self._thread.start()
        while not self._server.started:
            time.sleep(0.02)

    def stop(self) -> None:
        """Answer no more."""
        self._server.should_exit = self._server.force_exit = True
        self._thread.join(timeout=10)

    def close(self) -> None:
        """End everything."""
        self.stop()
        self.tasks.pool.close()


@contextlib.contextmanager
def chromium() -> Iterator:
    """Yield a browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield browser
        browser.close()
