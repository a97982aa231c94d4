"""The documentation builds without a warning, and its pages load nothing from other hosts."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOADED = re.compile(r"""<(?:script|img|iframe|source)\b[^>]*\bsrc="([^"]+)|<link\b[^>]*\bhref="([^"]+)""")


@pytest.mark.long
def test_the_documentation_builds_without_a_warning_and_without_other_hosts(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-q", "-E", "-n", "-W", "--keep-going", "docs", str(tmp_path)]
    command += [
        "-D",
        "toc_object_entries=0",
    ]  # every function in every page's menu: a third of the time, no warning
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    pages = sorted(tmp_path.rglob("*.html"))
    assert {"index.html", "theory.html", "conventions.html", "tutorial.html"} <= {page.name for page in pages}
    for page in pages:
        for loaded in LOADED.findall(page.read_text()):
            assert "//" not in "".join(loaded), f"{page.name} loads {loaded}"
    for sheet in tmp_path.rglob("*.css"):
        assert not re.search(r"url\([\"']?(?:https?:)?//|@import", sheet.read_text()), (
            f"{sheet.name} loads something"
        )
    theory = (tmp_path / "theory.html").read_text()
    assert "<math " in theory
    assert 'href="api/render.html#lightprobe.render.split_sum.shade"' in theory
