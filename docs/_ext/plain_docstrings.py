"""Docstrings as they are written here, made into what Sphinx reads.

They are plain text: names in single backticks, equations and tables in indented or aligned blocks, no markup.
So blocks become literal, names code, and whatever Sphinx would take for markup is escaped. The fields of a
dataclass are shown with the comments behind them, where shapes and units stand.
"""

import ast
import dataclasses
import inspect
import re
import textwrap
from typing import Any

from sphinx.application import Sphinx

_ALIGNED = re.compile(r"\S {2,}\S")
_ITEM = re.compile(r"- |\d+\. ")
_SPAN = re.compile(r"(`[^`]+`|\*\*[A-Z][^*]*\*\*)")


def to_rest(lines: list[str]) -> list[str]:
    """Return a docstring's lines as reStructuredText."""
    rest: list[str] = []
    for block in _blocks(lines):
        if _is_literal(block):
            rest += [".. code-block:: text", "", *("    " + line for line in block), ""]
        else:
            rest += [*_prose(block), ""]
    return rest


def _blocks(lines: list[str]) -> list[list[str]]:
    """Split lines where a blank line, an indented block or a list begins; a literal block may hold blank
    lines.
    """
    blocks: list[list[str]] = []
    fresh = True
    for line in lines:
        if not line.strip():
            fresh = True
            continue
        indented = line[:1] == " "
        if indented and blocks and (blocks[-1][0][:1] == " " or (not fresh and _ITEM.match(blocks[-1][0]))):
            blocks[-1] += [""] * fresh + [line]
        elif fresh or _ITEM.match(line) or indented != (blocks[-1][-1][:1] == " "):
            blocks.append([line])
        else:
            blocks[-1].append(line)
        fresh = False
    return blocks


def _is_literal(block: list[str]) -> bool:
    return block[0][:1] == " " or any(_ALIGNED.search(line) for line in block)


def _prose(block: list[str]) -> list[str]:
    rest = ""
    for part in _SPAN.split("\n".join(block)):
        glued = rest.endswith("``") and re.match(
            r"[^\s.,;:!?'\")\]}>/-]", part
        )  # markup ends at a blank or a mark
        rest += ("\\ " if glued else "") + _inline(part)
    return rest.split("\n")


def _inline(part: str) -> str:
    if part.startswith("`"):
        return "``" + re.sub(r"\s+", " ", part.strip("`")) + "``"
    return part if part.startswith("**") else re.sub(r"([\\*|`]|_\b)", r"\\\1", part)


def fields(cls: type) -> list[str]:
    """Return the source lines of a dataclass's fields, comments included; none where fields have docstrings."""
    body = ast.parse(source := textwrap.dedent(inspect.getsource(cls))).body[0].body  # type: ignore[attr-defined]
    after = [*body[1:], None]
    if any(isinstance(one, ast.AnnAssign) and _is_string(two) for one, two in zip(body, after, strict=True)):
        return []
    rows = [
        row
        for item in body
        if isinstance(item, ast.AnnAssign)
        for row in range(item.lineno - 1, item.end_lineno)
    ]
    return [source.splitlines()[row].removeprefix("    ") for row in rows]


def _is_string(node: ast.stmt | None) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def process(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Rewrite a docstring in place, as Sphinx asks."""
    lines[:] = to_rest(lines)
    if what == "class" and dataclasses.is_dataclass(value) and (rows := fields(value)):
        lines += [".. code-block:: python", "", *("    " + row for row in rows), ""]


def shown_defaults(
    app: Sphinx, what: str, name: str, value: Any, options: Any, given: str, returned: str
) -> Any:
    """Return a signature whose defaults are Python again: Sphinx reads it, and links its types, only then."""
    return re.sub(r"<(\w+\.\w+): [^<>]*>", r"\1", (given or "").replace("<factory>", "...")) or None, returned


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to autodoc."""
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-process-signature", shown_defaults)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
