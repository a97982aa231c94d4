"""The page from start to end: what is shown, where it listens, and what is cleared away afterwards."""

import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path

from lightprobe.core.extras import extra_library
from lightprobe.core.partial import partial_folder
from lightprobe.view.network import Address, open_address, qr_code
from lightprobe.view.sources import Sources
from lightprobe.web.listening import run_app, until_interrupted
from lightprobe.web.worker import WorkerProcess, worker_command

PORT = 8421
"""Where the page is unless another port is asked for."""


def serve(
    folders: Sequence[Path],
    *,
    port: int = PORT,
    lan: bool = False,
    browser: bool = True,
    device: str = "auto",
    tell: Callable[[str], None] = print,
) -> None:
    """Serve the page of runs, and of scenes to correct, until it is interrupted.

    folders: runs, scenes that `lightprobe prepare` made, or folders of photos. lan: let devices in the same
    network open it, too, by an address with a token, which `tell` is given with a QR code. browser: open it
    here. Everything that is uploaded or computed lies in a temporary folder, which goes with the server.
    Raises `InputError` for a folder that is none of these, `ConfigError` for a port that is none or without
    the extra `view`, `ResourceError` for a port in use.
    """
    for library in ("fastapi", "uvicorn", *(["segno"] if lan else [])):
        extra_library(library, "The page of a run", "view")
    sources = Sources.of(folders)
    address = open_address(port, lan=lan)
    with until_interrupted(), address.listening, partial_folder(Path(tempfile.gettempdir())) as folder:
        _announce(address, tell)
        if browser:
            webbrowser.open(address.local_url)
        _run(sources, address, folder, device)


def _announce(address: Address, tell: Callable[[str], None]) -> None:
    tell(f"Page: {address.local_url}   (end with Ctrl-C)")
    if address.network_url is not None:
        tell(f"For the phone, in the same network: {address.network_url}")
        tell(qr_code(address.network_url))


def _run(sources: Sources, address: Address, folder: Path, device: str) -> None:
    """Answer requests on the address's socket, files in `folder`, until a signal ends it."""
    from uvicorn.config import LOGGING_CONFIG

    from lightprobe.view.app import create_app
    from lightprobe.view.routes import Session
    from lightprobe.view.tasks import Tasks
    from lightprobe.view.uploads import Uploads

    for part in ("uploads", "tasks", "pictures"):
        (folder / part).mkdir()
    command = worker_command("lightprobe.view.worker", device)
    tasks = Tasks(folder / "tasks", lambda number: WorkerProcess(command))
    try:
        session = Session(sources, Uploads(folder / "uploads"), tasks, folder / "pictures")
        app = create_app(session, address.hosts, address.token)
        run_app(app, address.listening, grace=2, log_config=LOGGING_CONFIG)
    finally:
        tasks.pool.close()
