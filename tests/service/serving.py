"""A service whose workers compute nothing, on a port of its own; what a photo is called says what becomes of
it.
"""

import contextlib
import json
import sys
import tempfile
import textwrap
import threading
import time

import httpx2
import uvicorn

from lightprobe.service import server as module

FAKE = """
    import json, os, sys, time
    from pathlib import Path
    known = []
    for line in sys.stdin:
        asked = json.loads(line)
        if asked["task"] == "start":
            print(json.dumps({"result": {"ready": True}}), flush=True)
            continue
        run, folder = Path(asked["run"]), Path(asked["folder"])
        what = asked["name"].partition(".")[0]
        (run / "pid").write_text(str(os.getpid()))
        if what == "slow":
            time.sleep(60)
        while what == "waits" and not (run / "go").exists():
            time.sleep(0.01)
        if what == "fails":
            print(json.dumps({"error": "This cannot be done.", "kind": "InputError"}), flush=True)
            continue
        known = [one for one in known if one != run.name] + [run.name]
        names = {"exr": "light.exr", "hdr": "light.hdr", "confidence": "confidence.exr"}
        for output in asked["outputs"]:
            (folder / names[output]).write_text(output)
        print(json.dumps({"result": {
            "method": "solve", "verdict": {"status": "good"}, "pose": None, "warnings": [], "light": {"asked": asked},
            "files": [names[output] for output in asked["outputs"]], "seconds": {"all": 0.01, "pid": os.getpid()},
            "worker": {"objects": known, "held": 1, "loads": len(known), "evictions": 0},
        }}), flush=True)
"""
PNG = b"\x89PNG\r\n\x1a\n and no more"


def fake_worker(runs, config, assignment):
    """Return the command of a worker that computes nothing."""
    return sys.executable, "-S", "-c", textwrap.dedent(FAKE)


def runs_folder(folder, *names):
    """Return a folder of what looks like runs."""
    for name in names or ("cup",):
        (folder / name / "mesh").mkdir(parents=True)
        (folder / name / "config.json").write_text("{}")
        (folder / name / "mesh" / "asset.safetensors").touch()
    return folder


class Served:
    """A service that runs, and a client of it."""

    def __init__(self, url, server, thread, runs):
        self.url, self.server, self.thread, self.runs = url, server, thread, runs
        self.client = httpx2.Client(base_url=url, timeout=30)

    def predict(self, photo="good.png", *, object="cup", content=PNG, headers=None, **fields):
        """Return the answer to a photo of a name."""
        path = f"/objects/{object}/predict"
        return self.client.post(path, files={"photo": (photo, content)}, data=fields, headers=headers)

    def later(self, photo, **fields):
        """Ask for a prediction in a thread; return the list that the answer comes to, and the thread."""
        answers = []
        thread = threading.Thread(target=lambda: answers.append(self.predict(photo, **fields)), daemon=True)
        thread.start()
        return answers, thread

    def metric(self, name):
        """Return a sample of the metrics, its labels in its name."""
        lines = [
            line for line in self.client.get("/metrics").text.splitlines() if line.startswith(f"{name} ")
        ]
        return float(lines[0].split()[-1]) if lines else 0.0

    def until(self, true, seconds=15.0):
        """Wait until something is so."""
        end = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end
            time.sleep(0.02)


@contextlib.contextmanager
def serving(tmp_path, monkeypatch, *, names=(), worker=fake_worker, workers=1, runs=None, **config):
    """Yield a service; what is not an option of `ServiceConfig` goes to `serve`."""
    temporary = tmp_path / "temporary"
    temporary.mkdir(exist_ok=True)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setattr(module, "worker_arguments", worker)
    servers, said = [], []
    start = uvicorn.Server.__init__
    monkeypatch.setattr(uvicorn.Server, "__init__", lambda self, *a: servers.append(self) or start(self, *a))
    others = {key: config.pop(key) for key in ("token", "host", "anyone") if key in config}
    settings = module.ServiceConfig(**config)
    runs = runs or runs_folder(tmp_path / "runs", *names)
    work = threading.Thread(
        target=lambda: said.append(
            module.serve(runs, port=0, workers=workers, config=settings, tell=said.append, **others)
        ),
        daemon=True,
    )
    work.start()
    end = time.monotonic() + 240
    while not (servers and servers[0].started):
        assert work.is_alive(), "the service did not start"
        assert time.monotonic() < end
        time.sleep(0.02)
    served = Served(said[0].split()[1], servers[0], work, runs)
    served.until(lambda: served.client.get("/ready").status_code == 200, 240)
    try:
        yield served
    finally:
        servers[0].should_exit = True
        work.join(timeout=20)
    assert not work.is_alive()
    assert list(temporary.iterdir()) == []


def log_lines(text):
    """Return the lines of the log."""
    return [json.loads(line) for line in text.splitlines()]
