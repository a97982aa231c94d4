"""What the pages name exists: functions and modules, files that they link to, and the layers of the package."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src" / "lightprobe").glob("*/__init__.py"))
NAME = re.compile(rf"`(?:lightprobe\.)?((?:{'|'.join(PACKAGES)})\.[A-Za-z_][\w.]*?)(?:\(\))?`")
PICTURES = (".exr", ".hdr", ".png", ".jpg")
FILES = (*PICTURES, ".json", ".py", ".md", ".glb", ".txt", ".mtlx", ".safetensors", ".usdc", ".usdz")


def page_id(page: Path) -> str:
    return str(page.relative_to(ROOT))


def exists(name: str) -> bool:
    """Whether `name`, without the leading `lightprobe.`, is a module or can be reached from one by
    attributes.
    """
    parts = ["lightprobe", *name.split(".")]
    for length in range(len(parts), 1, -1):
        try:
            found = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[length:]:
            fields = getattr(found, "__dataclass_fields__", {})
            if not hasattr(found, attribute) and attribute not in fields:
                return False
            found = getattr(found, attribute, None)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_names_of_modules_and_functions_exist(page):
    names = {name for name in NAME.findall(page.read_text()) if not name.endswith(FILES)}
    assert not {name for name in names if not exists(name)}


def test_every_equation_of_the_theory_stands_beside_the_function_that_computes_it():
    text = (ROOT / "docs" / "theory.md").read_text()
    sections = re.split(r"^##+ ", text, flags=re.M)[1:]
    bare = [part.splitlines()[0] for part in sections if "```math" in part and not NAME.search(part)]
    assert not bare
    assert len(set(NAME.findall(text))) > 40


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_links_to_files_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
    targets = {
        target.partition("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target
    }
    missing = {target for target in targets if target and not (page.parent / target).exists()}
    assert not missing


def contract() -> list[set[str]]:
    """Return the layers of the import contract from the top, those that may not import each other in one set."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = next(contract["layers"] for contract in tool["contracts"] if contract["type"] == "layers")
    return [{name.strip().removeprefix("lightprobe.") for name in layer.split("|")} for layer in layers]


def drawn(page: Path) -> list[set[str]]:
    """Return the layers that the indented lines of a page draw: names of packages, and behind blanks what
    they are.
    """
    layers = []
    for line in re.findall(r"^ {4}(.+)", page.read_text(), flags=re.M):
        names = re.split(r" {2,}", line.strip().removeprefix("→ "))[0]
        row = [{name.strip() for name in layer.split("|")} for layer in re.split(r"[,>]", names)]
        layers += row if all(layer <= set(PACKAGES) for layer in row) else []
    return layers


def test_the_guide_for_contributors_draws_the_layers_from_the_command_line_downwards():
    assert drawn(ROOT / "CONTRIBUTING.md") == contract()


def test_the_reference_has_every_package_and_every_public_name():
    import lightprobe

    folder = ROOT / "docs" / "api"
    assert {page.stem for page in folder.glob("*.rst")} == set(PACKAGES) - {"cli"}
    modules = re.findall(
        r"automodule:: lightprobe\.(\S+)", "".join(page.read_text() for page in folder.glob("*.rst"))
    )
    assert not {module for module in modules if not exists(module)}
    index = (folder / "index.md").read_text()
    assert not {name for name in lightprobe.__all__ if f"`lightprobe.{name}`" not in index}


def test_every_decision_is_listed():
    folder = ROOT / "docs" / "decisions"
    listed = set(re.findall(r"\(([\w-]+)\.md\)", (folder / "index.md").read_text()))
    assert {page.stem for page in folder.glob("*.md")} - {"index"} == listed
