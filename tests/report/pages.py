"""Evaluated runs without a training, and a browser that looks at their pages."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.report.pictures import PICTURE_NOTES, data_uri
from lightprobe.report.report import Report, store_report

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs the browser Chromium")


def evaluation(scores: dict[str, float], method: str = "solve") -> dict:
    """Return metrics of photos whose object's PSNR is given."""
    photos = {
        name: {
            "psnr_masked": psnr,
            "seconds": 0.5,
            "methods": {method: {"psnr_masked": psnr, "seconds": 0.5}},
        }
        for name, psnr in scores.items()
    }
    mean = {"psnr_masked": sum(scores.values()) / len(scores), "seconds": 0.5}
    return {
        "default_method": method,
        "mean": mean,
        "methods": {method: mean},
        "interval": {},
        "photos": photos,
        "confidence": {},
    }


def report_with(metrics: dict, titles=tuple(PICTURE_NOTES)) -> Report:
    picture = data_uri(np.random.default_rng(0).random((40, 40, 3)))
    return Report(
        "cup", metrics, {name: dict.fromkeys(titles, picture) for name in metrics["photos"]}, {"seed": "0"}
    )


def evaluated_run(folder: Path, scores: dict[str, float], **more) -> RunFolder:
    """Write what an evaluation leaves for other pages."""
    run = RunFolder.create(folder)
    report = report_with(evaluation(scores, **more))
    write_json(run.metrics_file, report.metrics)
    store_report(run.report_file, report)
    return run


def run_in_browser(page: Path, script: str) -> object:
    """Return the JSON value of a script's expression, evaluated on the page in a browser without a screen."""
    assert CHROMIUM is not None
    probe = page.with_name("probe.html")
    ending = f"<script>document.body.textContent = '<<' + JSON.stringify({script}) + '>>';</script></body>"
    probe.write_text(page.read_text().replace("</body>", ending))
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--disable-background-networking",
    ]
    command = [CHROMIUM, *options, f"--user-data-dir={page.parent / 'profile'}", "--dump-dom", probe.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return json.loads(done.stdout.split("&lt;&lt;")[1].split("&gt;&gt;")[0])
