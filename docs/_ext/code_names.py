"""Code spans that name something of the package become links to its reference.

So pages and docstrings can say `render.brdf.environment_brdf`, as they do for readers of the plain files, and
need no markup that only Sphinx understands. Names are given with or without `lightprobe.` in front.
"""

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.nodes import make_refnode


class LinkNames(SphinxPostTransform):
    """Wraps a literal that names a documented object into a reference to it."""

    default_priority = 5

    def run(self, **kwargs: object) -> None:
        """Look at every literal of the page."""
        known = self.env.domains.python_domain.objects
        for literal in list(self.document.findall(nodes.literal)):
            text = literal.astext().removesuffix("()")
            entry = known.get(f"lightprobe.{text}") or known.get(text)
            if entry is None or "." not in text or isinstance(literal.parent, nodes.reference):
                continue
            place = self.app.builder, self.env.docname, entry.docname, entry.node_id
            literal.replace_self(make_refnode(*place, literal.deepcopy()))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the transform."""
    app.add_post_transform(LinkNames)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
