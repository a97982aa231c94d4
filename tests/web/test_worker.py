"""Both ends of a worker process, over a pipe."""

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from lightprobe.core.errors import InputError, LightprobeWarning, ResourceError
from lightprobe.core.failures import UnexpectedError
from lightprobe.web.errors import WorkerEndedError, received, reported, sent_kind
from lightprobe.web.worker import START, WorkerProcess, answer_requests, worker_command

ROOT = Path(__file__).parents[2]
HERE = {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}


def answer(request, tell):
    """Do what a request asks for."""
    tell("at work")
    print("what a library prints is no answer")
    match request["task"]:
        case "warn":
            warnings.warn("Mind the file.", LightprobeWarning, stacklevel=1)
            warnings.warn("Not ours.", UserWarning, stacklevel=1)
        case "refuse":
            raise InputError("The file is no photo.")
        case "break":
            raise KeyError("what")
        case "end":
            raise SystemExit(1)
    return {"done": request["task"]}


def reworded(request, sentence):
    """Name the file."""
    return sentence.replace("The file", "a.png")


def test_each_request_is_answered_by_stages_and_a_result_or_a_sentence():
    requests = [START, *({"task": task} for task in ("warn", "refuse", "break", "good"))]
    lines = "".join(f"{json.dumps(request)}\n" for request in requests)
    command, env = worker_command("tests.web.test_worker"), {**os.environ, **HERE}
    ended = subprocess.run(command, env=env, input=lines, capture_output=True, text=True, check=True)
    said = [json.loads(line) for line in ended.stdout.splitlines()]
    assert said[0] == {"result": {"ready": True}}
    assert said[1::2] == [{"stage": "at work"}] * 4
    warned, refused, broken, good = said[2::2]
    assert warned == {"result": {"done": "warn", "warnings": ["Mind the file."]}}
    assert refused == {"error": "a.png is no photo.", "kind": "InputError"}
    assert broken["kind"] == "UnexpectedError"
    assert good["result"] == {"done": "good", "warnings": []}
    assert "no answer" in ended.stderr


def test_a_server_is_told_stages_results_and_errors():
    said, texts = [], []
    command = worker_command("tests.web.test_worker")
    process = WorkerProcess(command, environment=HERE, on_text=texts.append)
    assert process.ask(START, said.append) == {"ready": True}
    assert process.ask({"task": "good"}, said.append)["done"] == "good"
    with pytest.raises(InputError, match=r"a\.png is no photo"):
        process.ask({"task": "refuse"}, said.append)
    with pytest.raises(UnexpectedError):
        process.ask({"task": "break"}, said.append)
    assert process.alive
    with pytest.raises(WorkerEndedError, match="has ended"):
        process.ask({"task": "end"}, said.append)
    assert not process.alive
    assert said == ["at work"] * 4
    assert any("KeyError" in text for text in texts)


@pytest.mark.parametrize("error", [ValueError("no"), BrokenPipeError(), MemoryError(), OSError(28, "full")])
def test_whatever_goes_wrong_is_told_and_comes_back_as_the_same_kind(error):
    known = reported(error, lambda traceback: None)
    assert type(received(str(known), sent_kind(known))) is type(known)
    assert isinstance(known, UnexpectedError if isinstance(error, ValueError) else ResourceError)


if __name__ == "__main__":
    answer_requests(answer, reworded, lambda text: print(text, file=sys.stderr, flush=True))
