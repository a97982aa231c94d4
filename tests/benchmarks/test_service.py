"""The load test counts what is lost and wrong, and hostile requests are refused."""

import argparse
import os
import random

import httpx2
import pytest

import measure_service
from tests.service.serving import serving
from tests.toy_scene import write_toy_scene

OPTIONS = {
    "requests": 24,
    "clients": 3,
    "hostile": 0.4,
    "slow": 1,
    "kill_every": 0.0,
    "fields": {},
    "method": "",
    "sources": "true",
}


@pytest.fixture
def served(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch, names=(measure_service._OBJECT,)) as one:
        yield one


def shots(tmp_path):
    scene = write_toy_scene(tmp_path / "scene", train=3, test=1)
    return [
        measure_service.Shot(shot.name, shot.data, shot.camera, b"exr")
        for shot in measure_service.scene_shots(scene)
    ]


@pytest.mark.slow
def test_requests_are_counted_by_what_came_of_them(served, tmp_path, monkeypatch):
    options = argparse.Namespace(**OPTIONS)
    photos = shots(tmp_path)
    assert photos[0].data.startswith(b"\x89PNG")
    monkeypatch.setattr(measure_service, "hostile", lambda client, shot, draw: client.get("/nothing"))
    with measure_service.disturbances(served.url, os.getpid(), options) as counts:
        tally = measure_service.load(served.url, [os.getpid()], photos, options)
        served.until(lambda: counts["slow"] > 0)
    assert len(tally.seconds) + tally.hostile[404] == 24
    assert tally.hostile[404] > 3
    assert (tally.lost, tally.wrong) == ([], [])
    table = measure_service.row(tally, counts, 2 * tally.memory_early, 2.0, options)
    assert "| 100.0 % |" in table
    wrong = [measure_service.Shot(shot.name, shot.data, shot.camera, b"another") for shot in photos]
    monkeypatch.setattr(measure_service, "same_map", lambda one, other: one == other)
    assert len(measure_service.load(served.url, [os.getpid()], wrong, options).wrong) == len(tally.seconds)
    gone = measure_service.load("http://127.0.0.1:9/", [os.getpid()], photos, options)
    assert len(gone.lost) == 24


def test_every_kind_of_hostile_request_is_refused_in_a_sentence(served, tmp_path):
    """Those that a decoder has to see are left to real workers."""
    shot, seen = shots(tmp_path)[0], set()
    with httpx2.Client(base_url=served.url, timeout=30) as client:
        for kind in (2, 3, 4, 5, 6, 8):
            seed = next(n for n in range(1000) if random.Random(n).randrange(9) == kind)
            answer = measure_service.hostile(client, shot, random.Random(seed))
            assert 400 <= answer.status_code < 500, (kind, answer.text)
            assert answer.json()["sentence"]
            seen.add(answer.status_code)
    assert seen == {404, 415, 422}


def test_a_bomb_is_small_and_its_processes_are_found():
    assert len(measure_service.bomb()) < 200
    assert measure_service.memory(os.getpid()) > 10
