"""A short attack; what the long one has found stands beside the tests of what was mended."""

import asyncio
import logging
import signal
from pathlib import Path

import pytest

from lightprobe.core.errors import InputError
from lightprobe.web.asgi import reply
from tests.fuzz import requests, servers, worker
from tests.fuzz.__main__ import Attack, main, page
from tests.fuzz.connection import Answer
from tests.fuzz.edits import JSON, Splice, drawn, fewest, spoilt, value_edits, with_checksums
from tests.fuzz.targets import TARGETS, Target


def defects(root: Path, path: Path) -> None:
    """Do what a file's first byte asks for."""
    content = path.read_bytes()[:1]
    if content == b"k":
        signal.raise_signal(signal.SIGKILL)
    if content == b"m":
        bytearray(2**33)
    if content == b"h":
        signal.pause()
    if content == b"e":
        raise KeyError("a")
    if content == b"s":
        raise InputError("no full stop")
    if content == b"r":
        raise InputError("Refused.")


@pytest.mark.slow
def test_edits_follow_from_their_seed_and_leave_what_they_do_not_name():
    assert drawn(value_edits(), 20, 3) == drawn(value_edits(), 20, 3) != drawn(value_edits(), 20, 4)
    assert spoilt(b"abcdef", [Splice(2, 1, b"XY"), Splice(14, 9, b"")], None) == b"abXYde"
    assert JSON.read(spoilt(b'{"a": [1, 2]}', drawn(value_edits(), 1, 0)[0], JSON)) is not None


def test_edits_that_a_failure_does_not_need_are_left_away():
    assert fewest([1, 2, 3, 4], lambda edits: 3 in edits and 1 in edits) == [1, 3]


def test_a_png_gets_its_checksums_back(tmp_path):
    png = next(target for target in TARGETS if target.name == "PNG")
    png.make(tmp_path)
    sound = (tmp_path / "8.png").read_bytes()
    assert with_checksums(sound) == sound
    assert with_checksums(sound[:29] + b"xxxx" + sound[33:]) == sound


@pytest.mark.long
def test_whatever_a_reader_does_is_told_apart(tmp_path):
    """Each in a process of its own kind: one that is killed, hangs, or takes all memory ends nobody else."""
    attacked = worker.Worker(tmp_path / "corpus", "tests.fuzz.test_fuzz:DEFECTS", seconds=1.0)
    DEFECTS[0].write(tmp_path / "corpus")
    try:
        found = {kind: attacked.read("defects", "a", kind.encode()) for kind in "rkmhes "}
    finally:
        attacked.close()
    words = {
        "k": "death of the process",
        "m": "MemoryError",
        "h": "hang",
        "e": "KeyError",
        "s": "no sentence",
    }
    told = {kind: outcome.finding.partition(" in ")[0] for kind, outcome in found.items()}
    assert told == {**words, "r": "", " ": ""}
    assert [found[kind].refused for kind in "r "] == [True, False]


def _one_file(folder: Path) -> None:
    (folder / "a").write_bytes(b" ")


DEFECTS = (Target("defects", _one_file, "a", defects),)


@pytest.mark.slow
def test_every_reader_survives_a_short_attack(tmp_path):
    attack = Attack(tmp_path, seed=26)
    try:
        assert attack.check_corpus() == []
        attack.turn(0, batch=4)
    finally:
        attack.close()
    assert {name: tally.findings for name, tally in attack.tallies.items() if tally.findings} == {}
    assert all(tally.files >= 2 for tally in attack.tallies.values())


def test_a_finding_is_kept_with_the_edits_that_show_it_and_told_in_a_table(tmp_path, capsys, monkeypatch):
    found = worker.Outcome("KeyError in GLB at thing.py:load_virtual_object", "a trace")
    monkeypatch.setattr(worker.Worker, "read", lambda self, target, file, data: found)
    attack = Attack(tmp_path, 0, [target for target in TARGETS if target.name == "GLB"])
    assert len(attack.check_corpus()) == 2
    attack.turn(0, batch=2)
    (kept,) = (tmp_path / "findings").glob("*.txt")
    assert kept.read_text().startswith(f"{found.finding}\n\nGLB, ")
    assert kept.with_suffix("").is_file()
    assert found.finding in capsys.readouterr().out
    assert "| GLB | 2 | 0 | 0 | 1 |" in page(attack, 0)


def test_the_command_writes_its_record(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(worker.Worker, "read", lambda self, target, file, data: worker.Outcome())
    record = tmp_path / "a.md"
    assert main(["--minutes", "0", "--folder", str(tmp_path), "--page", str(record), "--only", "GLB"]) == 0
    assert "| GLB | 0 | 0 | 0 | 0 |" in record.read_text()
    assert "0 findings" in capsys.readouterr().out


def test_a_request_is_written_from_what_it_says_and_its_length_is_mended(tmp_path):
    requests.write(tmp_path, requests.service_requests() | requests.page_requests(b"a", b"b", b"c"))
    for file in tmp_path.glob("*.http"):
        data = file.read_bytes()
        assert data.startswith(requests.REQUEST.write(b"", requests.REQUEST.read(data)))
    head, _, body = requests.with_length((tmp_path / "all.http").read_bytes()[:-9]).partition(b"\r\n\r\n")
    assert f"content-length: {len(body)}".encode() in head


@pytest.mark.parametrize(
    ("does", "kind"), [("raises", "an error leaves"), ("writes", "a file outside"), ("logs", "log")]
)
def test_whatever_a_server_does_wrong_is_found(tmp_path, does, kind):
    async def app(scope, receive, send):
        if does == "raises":
            raise KeyError("a")
        if does == "writes":
            (tmp_path / "elsewhere").write_text("a")
        if does == "logs":
            logging.getLogger("uvicorn.error").error("no", exc_info=KeyError("a"))
        await reply(send, 200, "Well.")

    server = servers.Server(app, (tmp_path / "folder",), servers.Writes())
    with pytest.raises(worker.DefectError, match=kind):
        server.ask(asyncio.new_event_loop(), b"GET / HTTP/1.1\r\nhost: a\r\n\r\n")


@pytest.mark.parametrize(
    ("status", "body", "kind"),
    [
        (422, b"no", "no JSON"),
        (422, b'{"sentence": "no stop"}', "no sentence"),
        (418, b'{"sentence": "A pot."}', "418"),
        (500, b'{"sentence": "Why."}', "the status 500"),
        (422, b'{"sentence": "See /secret/place."}', "a path"),
    ],
)
def test_an_answer_that_is_not_documented_is_found(status, body, kind):
    answer = Answer("GET", "/", status, {}, bytearray(body), ended=True)
    with pytest.raises(worker.DefectError, match=kind):
        servers.check_answer(answer, {422}, (Path("/secret/place"), Path("/secret/runs")))
