"""The limit of --max-memory: sizes as they are typed, what is left, and the end of a process that passes it."""

import os
import subprocess
import sys

import pytest

from lightprobe.core import memory_limit
from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.memory import resident_bytes

GREEDY = """
import time
import numpy as np
from lightprobe.core.memory_limit import memory_limit
with memory_limit(600 * 10**6, lambda sentence: print(sentence, flush=True)):
    held = []
    for _ in range(40):
        held.append(np.ones(2**22))  # 34 MB
        time.sleep(0.05)
print("it went on")
"""


@pytest.mark.parametrize(
    ("text", "size"),
    [("4GB", 4 * 10**9), ("512MB", 512 * 10**6), ("1.5 GiB", 3 * 2**29), ("900MiB", 900 * 2**20)],
)
def test_sizes_as_they_are_typed(text, size):
    assert memory_limit.parse_size(text) == size


@pytest.mark.parametrize("text", ["", "4", "GB", "4gb", "-1GB", "0GB", "4GB and more", "nanGB", "1e9MB"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(ConfigError, match="4GB or 512MB"):
        memory_limit.parse_size(text)


def test_what_is_left_is_the_limit_without_what_the_process_holds():
    assert memory_limit.memory_left() is None
    held = resident_bytes(os.getpid())
    with memory_limit.memory_limit(held + 2**30):
        left = memory_limit.memory_left()
        assert left == pytest.approx(2**30 - 128 * 2**20, abs=2**26)
        with memory_limit.memory_limit(None):
            assert memory_limit.current_limit() == held + 2**30
    assert memory_limit.memory_left() is None


def test_a_limit_that_is_passed_already_is_refused():
    sentence = r"0\.05 GB is less than the .* before it begins"
    with pytest.raises(ResourceError, match=sentence), memory_limit.memory_limit(50 * 10**6):
        pass


@pytest.mark.slow
def test_a_process_that_passes_its_limit_ends_with_a_sentence():
    done = subprocess.run([sys.executable, "-c", GREEDY], capture_output=True, text=True, check=False)
    assert done.returncode == ResourceError.exit_code
    assert "more than --max-memory 0.60 GB; give it more" in done.stderr
    assert "it went on" not in done.stdout
    assert done.stderr == f"lightprobe: {done.stdout}"
