"""Check that a version can be released, and tag it; nothing is pushed.

    python tools/release.py [--check] [--without-wheel]

The version is that of pyproject.toml and a semantic one: X.Y.Z, raised in X where a run folder, a command or
a function of `lightprobe` no longer does what it did, in Y where there is something new, else in Z; before
1.0.0, Y stands for X. Nothing may be left uncommitted, CHANGELOG.md must begin with the version's section and
its date, the version must be higher than the last tag's, licences must be allowed, and the wheel must work
(`tools/check_wheel.py`). With --check no tag is made. Ends with 1 and one sentence for each thing that is in
the way.
"""

import argparse
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
_SEMANTIC = re.compile(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)")
_SECTION = re.compile(r"^## (\S+) \(([^)]*)\)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_DATE = re.compile(r"\d{4}-\d\d-\d\d")


def version_of(root: Path = ROOT) -> str:
    """Return the version in pyproject.toml."""
    return str(tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"])


def notes(changelog: str, version: str) -> str:
    """Return the text of a version's section, empty where the changelog does not begin with it."""
    first = _SECTION.search(changelog)
    return first[3].strip() if first is not None and first[1] == version else ""


def obstacles(root: Path = ROOT) -> Iterator[str]:
    """Yield a sentence for everything that is in the way of a release, but for licences and the wheel."""
    version = version_of(root)
    if _SEMANTIC.fullmatch(version) is None:
        yield f"pyproject.toml has the version {version}, which is not X.Y.Z."
        return
    if changed := _git(root, "status", "--porcelain"):
        yield f"There are changes that are not committed: {changed.splitlines()[0].strip()}, and perhaps more."
    first = _SECTION.search((root / "CHANGELOG.md").read_text())
    if first is None or first[1] != version or not first[3].strip():
        yield f"CHANGELOG.md does not begin with a section '## {version} (date)' that says what is new."
    elif _DATE.fullmatch(first[2]) is None:
        yield f"CHANGELOG.md gives {version} no date: '({first[2]})' must be '(YYYY-MM-DD)'."
    tags = [tag.removeprefix("v") for tag in _git(root, "tag", "--list", "v*").split()]
    released = [_parts(tag) for tag in tags if _SEMANTIC.fullmatch(tag)]
    if released and _parts(version) <= max(released):
        newest = ".".join(map(str, max(released)))
        yield f"{version} is not higher than {newest}, which is tagged; raise it in pyproject.toml."


def tag(root: Path = ROOT) -> str:
    """Tag the commit with the version, the changelog's section as message; return the tag's name."""
    version = version_of(root)
    text = f"lightprobe {version}\n\n{notes((root / 'CHANGELOG.md').read_text(), version)}\n"
    _git(root, "tag", "--annotate", f"v{version}", "--cleanup=verbatim", "--message", text)
    return f"v{version}"


def _parts(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True).stdout


def _passes(name: str) -> bool:
    return subprocess.run([sys.executable, str(ROOT / "tools" / name)]).returncode == 0


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line, check, tag, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="make no tag")
    parser.add_argument("--without-wheel", action="store_true", help="the wheel was checked elsewhere")
    given = parser.parse_args(words)
    found = list(obstacles())
    if not found:
        tools = ["check_licences.py", *([] if given.without_wheel else ["check_wheel.py"])]
        found = [f"tools/{name} fails; see above." for name in tools if not _passes(name)]
    if found:
        print("\n".join(found))
        return 1
    if given.check:
        print(f"{version_of()} can be released.")
        return 0
    name = tag()
    print(f"Tagged {name}; publish it with: git push origin {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
