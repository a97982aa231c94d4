"""Who computes where, who may ask, what an Accept header prefers, and what a listing holds."""

import json
import logging
from pathlib import Path

import pytest

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.service.answers import AnswerKind, accepted_kind
from lightprobe.service.devices import assignments
from lightprobe.service.objects import Objects
from lightprobe.service.server import ServiceConfig, check_access, read_token, worker_arguments
from lightprobe.service.telemetry import JsonLines
from lightprobe.web.errors import RefusedError
from tests.service.serving import runs_folder


def test_workers_share_the_cores_and_gpus_get_one_each():
    assert [(one.device, one.threads) for one in assignments((), None, cores=8)] == [("cpu", 2)] * 4
    assert [(one.device, one.threads) for one in assignments((), None, cores=1)] == [("cpu", 1)]
    assert [(one.device, one.threads) for one in assignments(("cpu",), 3, cores=2)] == [("cpu", 1)] * 3
    two = assignments(("cuda:0", "cuda:1"), None, cores=16)
    assert [(one.device, one.threads) for one in two] == [("cuda:0", 8), ("cuda:1", 8)]
    assert assignments(("cuda:1", "cuda:0"), 2, cores=16)[0].device == "cuda:1"
    assert two[0].environment["OMP_NUM_THREADS"] == "8"
    assert two[0].environment["OPENBLAS_NUM_THREADS"] == "1"  # they spin whatever they are told


@pytest.mark.parametrize(
    ("devices", "workers", "words"),
    [
        (("cuda:0", "cuda:0"), None, "twice"),
        (("cuda:0",), 2, "does not fit"),
        ((), 0, "computes nothing"),
        (("cpu", "cuda:0"), 3, "does not fit"),
    ],
)
def test_workers_that_do_not_fit_are_refused(devices, workers, words):
    with pytest.raises(ConfigError, match=words):
        assignments(devices, workers)


def test_a_worker_is_told_its_limits():
    (one,) = assignments((), 1, cores=3)
    command = worker_arguments(Path("runs"), ServiceConfig(cache_memory=0.5, max_megapixels=2), one)
    assert command[-5:] == ("runs", "cpu", "3", str(2**29), "2000000")


@pytest.mark.parametrize(
    "limits", [{"queue": 0}, {"deadline": 0}, {"worker_memory": float("nan")}, {"uploads": 0}]
)
def test_limits_that_let_nothing_through_are_refused(limits):
    with pytest.raises(ConfigError):
        ServiceConfig(**limits)


def test_without_a_token_only_this_machine_is_listened_to():
    for host in ("127.0.0.1", "::1", "localhost", "127.8.8.8"):
        check_access(host, None, anyone=False)
    for host in ("0.0.0.0", "", "192.168.1.2", "::", "example.org"):
        with pytest.raises(ConfigError, match="can be reached by others"):
            check_access(host, None, anyone=False)
        check_access(host, None, anyone=True)
        check_access(host, "x" * 16, anyone=False)
    for token in ("short", "ü" * 20, "a\nb" * 10):
        with pytest.raises(ConfigError, match="at least 16"):
            check_access("127.0.0.1", token, anyone=False)


def test_a_token_is_the_one_line_of_its_file(tmp_path):
    file = tmp_path / "token"
    file.write_text("secret-secret-secret\n")
    assert read_token(file) == "secret-secret-secret"
    for text in ("", "a\nb"):
        file.write_text(text)
        with pytest.raises(InputError, match="one line"):
            read_token(file)
    with pytest.raises(InputError):
        read_token(tmp_path / "missing")


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        ("", AnswerKind.JSON),
        ("*/*", AnswerKind.JSON),
        ("application/zip", AnswerKind.ZIP),
        ("image/*", AnswerKind.EXR),
        ("image/vnd.radiance;q=0.9, application/json;q=0.2", AnswerKind.HDR),
        ("application/json;q=0, */*;q=0.1", AnswerKind.ZIP),
        ("APPLICATION/ZIP; Q=1", AnswerKind.ZIP),
    ],
)
def test_accept_chooses_the_answer(header, kind):
    assert accepted_kind(header) is kind


@pytest.mark.parametrize("header", ["text/html", "image/png", "*/*;q=0", ";;,", "application/json;q=x"])
def test_an_answer_that_is_not_made(header):
    with pytest.raises(RefusedError, match="Accept"):
        accepted_kind(header)


def test_objects_come_and_go_and_are_listed_in_pages(tmp_path):
    runs = runs_folder(tmp_path / "runs", "a", "b", "c")
    objects = Objects(runs)
    first = objects.after("", 2)
    assert ([one.name for one in first.objects], first.next) == (["a", "b"], "b")
    last = objects.after("b", 1)
    assert ([one.name for one in last.objects], last.next) == (["c"], None)
    runs_folder(runs, "d")
    assert objects.find("d").path == runs.resolve() / "d"
    (runs / "d" / "config.json").unlink()
    with pytest.raises(RefusedError, match="GET /objects"):
        objects.find("d")
    with pytest.raises(InputError, match="no folder of runs"):
        Objects(tmp_path / "missing")
    with pytest.raises(InputError, match=f"is a run itself; .*: {runs}$"):
        Objects(runs / "a")


def test_a_log_line_is_one_object_whatever_is_logged(capsys):
    logger = logging.Logger("x")
    logger.addHandler(JsonLines())
    logger.info("two\nlines %s", "\x1b[31m")
    try:
        raise ValueError("no")
    except ValueError:
        logger.exception("failed")
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert lines[0]["text"] == "two\\nlines \\x1b[31m"
    assert "ValueError: no" in lines[1]["traceback"]
