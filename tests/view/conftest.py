"""A run, and the page's server as a client sees it, without a browser and with a worker that computes nothing."""

import json

import pytest
from starlette.testclient import TestClient

from lightprobe.view.app import create_app
from lightprobe.view.routes import Session
from lightprobe.view.sources import Sources
from lightprobe.web.worker import START
from tests.view.finished_run import finished_run
from tests.web.processes import FakeProcess

OWN = {"x-lightprobe": "1"}


class PageProcess(FakeProcess):
    """Leaves a file; what a photo is called says what else becomes of it."""

    def ask(self, request, on_stage):
        if request != START:
            json.dumps(request)  # as it goes through a pipe
            request = {"what": request.get("name", "").partition(".")[0], **request}
        told = super().ask(request, on_stage)
        if request != START:
            with open(f"{request['folder']}/light.exr", "x") as file:
                file.write("x")
        return {**told, "files": [{"name": "light.exr", "title": "light"}]}


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    """A finished run that is not to be changed."""
    return finished_run(tmp_path_factory.mktemp("view"))


@pytest.fixture
def session(tmp_path):
    """Make sessions that show some folders; their files lie in tmp_path / "session"."""
    made = []

    def make(*folders):
        made.append(Session.within(tmp_path / "session", Sources.of(folders), PageProcess))
        return made[-1]

    yield make
    for one in made:
        one.tasks.pool.close()


@pytest.fixture
def client_of(session):
    """Make clients of a page that shows some folders."""

    def make(*folders):
        app = create_app(session(*folders), frozenset({"testserver"}), None)
        return TestClient(app, headers=OWN, raise_server_exceptions=False)

    return make


@pytest.fixture
def client(client_of, run):
    """A client of a page that shows a finished run."""
    return client_of(run.path)
