"""How a damaged scene is refused."""

import json
import re

import pytest

from lightprobe.core.errors import InputError
from lightprobe.scene import load_scene
from lightprobe.scene.inspect import inspect

COUNT = 4


def refused(root, pattern, *others):
    """Assert that loading fails with one sentence matching `pattern`, and that an inspection reports it too.

    Of the problems that the inspection reports, one must hold each of the words `others`.
    """
    with pytest.raises(InputError, match=pattern) as caught:
        load_scene(root)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    problems = inspect(root).problems
    assert any(re.search(pattern, problem) for problem in problems)
    assert [sum(words in problem for problem in problems) for words in others] == [1] * len(others)


def edit_json(path, change):
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
