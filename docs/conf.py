"""Settings of the documentation's build: `make docs` writes build/docs/index.html from this folder.

Nothing is fetched, neither while building nor by the finished pages: no intersphinx, no fonts or scripts of
other hosts, equations as MathML, which browsers draw themselves.
"""

import importlib.metadata
import sys
from pathlib import Path

import fastapi  # noqa: F401  autodoc imports with TYPE_CHECKING set, under which its models cannot be made
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "lightprobe"
release = importlib.metadata.version("lightprobe")
copyright = "the lightprobe authors, Apache-2.0"

extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "plain_docstrings", "code_names"]
exclude_patterns = ["_ext"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_fence_as_directive = ["math"]  # GitHub draws ```math as well
suppress_warnings = ["myst.header"]  # a page that includes another starts with that one's title

html_theme = "furo"
html_title = "lightprobe"
html_math_renderer = "mathml"
html_show_sphinx = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
maximum_signature_line_length = 100

nitpick_ignore_regex = [
    # Other projects' names: they could be resolved with intersphinx only, which needs the network.
    ("py:.*", r"(torch|numpy|scipy|PIL|pathlib|collections|contextlib|types|typing|socket|starlette)\..*"),
    ("py:.*", r"(asyncio|concurrent|fastapi|logging|prometheus_client|pydantic|threading|uvicorn)\..*"),
    # What FastAPI's parameters are annotated with.
    (
        "py:class",
        r"(.*\.)?Annotated|Query|FieldInfo|(annotated_types\.)?(Ge|Gt|Le)|NoneType|PydanticUndefined|_thread\..*",
    ),
    # Private names and type variables, which have no entry of their own.
    ("py:class", r"lightprobe\.([a-z_0-9]+\.)+(_\w+|T|Item|Array|Task|Result|Row)"),
    ("py:class", "App"),
]

# The pages of decisions are listed by their index as a table; the site's menu needs them as a tree, too.
DECISIONS = """

```{toctree}
:hidden:
:glob:

*
```
"""


def list_decisions(app: Sphinx, page: str, source: list[str]) -> None:
    """Add the tree to the index, out of sight of those who read the file itself."""
    if page == "decisions/index":
        source[0] += DECISIONS


def setup(app: Sphinx) -> None:
    """Listen to what is read."""
    app.connect("source-read", list_decisions)
