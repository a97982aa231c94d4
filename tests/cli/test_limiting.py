"""--max-memory, as typed: taken out of the arguments, refused where it means nothing, and held."""

import json
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from benchmarks.memory import cli, peak
from lightprobe.cli.limiting import limit_among
from lightprobe.cli.main import main
from lightprobe.core.errors import ConfigError
from tests.cli.commands import fails

LIMIT = 600 * 10**6  # bytes; the program alone takes 0.4 GB


def test_the_option_is_taken_out_wherever_it_stands():
    assert limit_among("predict", ["run", "--max-memory", "2GB", "a.jpg"]) == (["run", "a.jpg"], 2 * 10**9)
    assert limit_among("predict", ["run", "--max-memory=1GiB"]) == (["run"], 2**30)
    assert limit_among("serve", ["runs"]) == (["runs"], None)


def test_a_value_that_is_no_size_and_a_command_of_many_processes_are_refused(tmp_path, capsys):
    assert fails(["inspect", tmp_path, "--max-memory", "much"], capsys, ["--max-memory", "4GB"]) == 3
    assert fails(["inspect", tmp_path, "--max-memory"], capsys, ["--max-memory", "4GB"]) == 3
    assert main(["inspect", str(tmp_path), "--json", "--max-memory", "much"]) == 3
    assert "4GB" in json.loads(capsys.readouterr().out)["error"]
    with pytest.raises(ConfigError, match="serve works in several"):
        limit_among("serve", ["runs", "--max-memory", "2GB"])


@pytest.mark.long
def test_a_large_jpeg_is_reduced_and_the_limit_is_held(tmp_path):
    """Of 64 megapixels, which take 256 MB decoded: without a limit `inspect` takes 0.66 GB."""
    ramp = np.linspace(0, 255, 8000).astype(np.uint8)
    Image.fromarray(np.broadcast_to(ramp[None, :, None], (8000, 8000, 3)).copy()).save(tmp_path / "a.jpg")
    memory, code, said = peak(cli("inspect", tmp_path, "--max-memory", f"{LIMIT // 10**6}MB"))
    assert code == 2, said  # one photo is too few
    assert memory * 2**30 < LIMIT, said
    assert "is reduced from 8000 x 8000 to 4000 x 4000 pixels" in said


@pytest.mark.slow
def test_a_bomb_is_refused_and_the_limit_is_held(tmp_path):
    """A header of 121 megapixels and no pixels: had they been asked for, the file would be called damaged."""
    header = b"IHDR" + struct.pack(">IIBBBBB", 11000, 11000, 8, 2, 0, 0, 0)
    chunks = [struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in (header, b"IEND")]
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    memory, code, said = peak(cli("inspect", tmp_path, "--max-memory", f"{LIMIT // 10**6}MB"))
    assert code == 2, said
    assert memory * 2**30 < LIMIT, said
    assert "a.png has 11000 x 11000 pixels" in said
    assert "more than --max-memory 0.60 GB; scale it down" in said
