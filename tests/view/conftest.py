"""A run and the server's application around it, without a browser."""

import sys
import textwrap

import pytest

from tests.view.finished_run import finished_run

ECHO = """
    import json, sys, time
    for line in sys.stdin:
        asked = json.loads(line)
        print(json.dumps({"stage": "at work"}), flush=True)
        what = asked.get("name")
        if what == "slow":
            time.sleep(60)
        if what == "dies":
            sys.exit(1)
        if what == "fails":
            print(json.dumps({"error": "This cannot be done."}), flush=True)
            continue
        open(asked["folder"] + "/light.exr", "w").write("x")
        print(json.dumps({"result": {"files": [{"name": "light.exr", "title": "light"}]}}), flush=True)
"""


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    """A finished run that is not to be changed."""
    return finished_run(tmp_path_factory.mktemp("view"))


@pytest.fixture
def worker():
    """The command of a worker that computes nothing, but waits, fails or dies when a request is named so."""
    return sys.executable, "-c", textwrap.dedent(ECHO)
