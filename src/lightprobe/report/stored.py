"""What a report was made from, kept beside it, so that other pages show the run without predicting again.

RUN/metrics.json            the scores
RUN/report/page.json        {"title", "facts", "commands", "pictures": photo -> title -> data URI of a JPEG}

A run may come from elsewhere: what goes into a page is checked here.
"""

import re
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.core.stored import checked_object, damaged, is_finite_number, read_object
from lightprobe.report.report import Report

_REMEDY = "make it anew with: lightprobe eval RUN"
_JPEG = re.compile(r"data:image/jpeg;base64,[A-Za-z0-9+/]+={0,2}")


def page_record(page: Path) -> Path:
    """Return where what a page was made from is kept."""
    return page.parent / "page.json"


def store_report(page: Path, report: Report) -> None:
    """Write what the report at `page` shows beside its numbers, as `read_report` reads it."""
    content = {key: getattr(report, key) for key in ("title", "facts", "commands", "pictures")}
    write_json(page_record(page), content)


def read_report(run: RunFolder) -> Report:
    """Return the report of an evaluated run, without its links.

    Raises `InputError` for a run that was not evaluated, or was by a version that kept no pictures, and for
    damage.
    """
    page = page_record(run.report_file)
    for path in (run.metrics_file, page):
        if not path.is_file():
            raise InputError(f"{run.path} has no {path.name} of an evaluation; {_REMEDY}.")
    stored = read_object(page, _REMEDY)
    pictures = checked_object(stored.get("pictures"), page, _REMEDY, "pictures")
    metrics = _checked_metrics(run.metrics_file)
    return Report(
        title=_text(stored.get("title"), page, "title"),
        metrics=metrics,
        pictures={
            photo: _pictures(each, page) for photo, each in pictures.items() if photo in metrics["photos"]
        },
        facts={
            heading: _text(fact, page, "facts")
            for heading, fact in checked_object(stored.get("facts"), page, _REMEDY, "facts").items()
        },
        commands=[_text(line, page, "commands") for line in _list(stored.get("commands"), page, "commands")],
    )


def _checked_metrics(path: Path) -> dict[str, Any]:
    """Return the content of a metrics.json that pages can be made from."""
    metrics = read_object(path, _REMEDY)
    for key in ("mean", "methods", "photos"):
        checked_object(metrics.get(key), path, _REMEDY, key)
    _numbers(metrics["mean"], path, "mean")
    for name, scores in metrics["methods"].items():
        _numbers(scores, path, name)
    for photo, scores in metrics["photos"].items():
        _numbers(
            {k: v for k, v in checked_object(scores, path, _REMEDY, photo).items() if k in metrics["mean"]},
            path,
            photo,
        )
        for method, each in checked_object(scores.get("methods", {}), path, _REMEDY, photo).items():
            _numbers(each, path, method)
    default = metrics.get("default_method")
    if not isinstance(default, str) or default not in metrics["methods"]:
        raise damaged(path, "'default_method' is none of its methods", _REMEDY)
    for key, inner in (("interval", _intervals), ("confidence", _confidence)):
        for method, value in checked_object(metrics.setdefault(key, {}), path, _REMEDY, key).items():
            inner(value, path, method)
    return metrics


def _intervals(value: Any, path: Path, method: str) -> None:
    _numbers(value, path, method)


def _confidence(value: Any, path: Path, method: str) -> None:
    for part in _list(checked_object(value, path, _REMEDY, method).get("bins"), path, "bins"):
        _numbers(part, path, "bins")


def _numbers(value: Any, path: Path, key: str) -> None:
    """Raise `InputError` unless `value` is an object of finite numbers."""
    for name, number in checked_object(value, path, _REMEDY, key).items():
        if not is_finite_number(number):
            raise damaged(path, f"'{name}' of '{key}' is no number", _REMEDY)


def _pictures(value: Any, path: Path) -> dict[str, str]:
    pictures = checked_object(value, path, _REMEDY, "pictures")
    for title, uri in pictures.items():
        if not isinstance(uri, str) or not _JPEG.fullmatch(uri):
            raise damaged(path, f"'{title}' is no picture", _REMEDY)
    return pictures


def _text(value: Any, path: Path, key: str) -> str:
    if not isinstance(value, str):
        raise damaged(path, f"'{key}' is no text", _REMEDY)
    return value


def _list(value: Any, path: Path, key: str) -> list[Any]:
    if not isinstance(value, list):
        raise damaged(path, f"'{key}' is no list", _REMEDY)
    return value
