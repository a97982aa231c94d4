"""One test photo on a page: what was photographed and predicted large, what explains it folded below."""

import html
from typing import Any

from lightprobe.report.headings import IMAGES, LIGHTS, Headings
from lightprobe.report.page import figure
from lightprobe.report.pictures import CONFIDENCE, OF_THE_LIGHT, OF_THE_VIEW

Pictures = dict[str, str]  # title -> data URI

ORDERS: Headings = {
    key: heading
    for key, heading in (IMAGES | LIGHTS).items()
    if key in ("psnr_masked", "psnr_unseen", "relit_psnr_scaled", "matte_si_rmse")
}
"""Scores that photos can be put in the order of."""


def photo_section(
    name: str, place: int, pictures: Pictures, scores: dict[str, Any], file_links: list[str]
) -> str:
    """Return a photo's section: `place` is its place in the order of the names, `file_links` are HTML."""
    header = f"<header><b>{html.escape(name)}</b><span>{html.escape(score_words(scores))}</span>"
    header += f"<span>{' · '.join(file_links)}</span></header>"
    folded = [title for title in pictures if title not in (*OF_THE_VIEW, *_light_titles(pictures))]
    body = lead(pictures)
    if folded:
        shown = "".join(figure(title, pictures[title]) for title in folded)
        opened = " open" if place == 0 else ""
        body += f"<details{opened}><summary>What explains them: difference, materials, confidence</summary>"
        body += f'<div class="row">{shown}</div></details>'
    return f'<section id="{anchor(place)}" data-place="{place}"{score_attributes(scores)}>{header}{body}</section>'


def lead(pictures: Pictures) -> str:
    """Return the large pictures: photo and render, and beside them the light and the spheres in it."""
    blocks = (("views", OF_THE_VIEW), ("light", _light_titles(pictures)))
    grids = [
        f'<div class="{kind}">{"".join(figure(title, pictures[title]) for title in titles if title in pictures)}</div>'
        for kind, titles in blocks
        if any(title in pictures for title in titles)
    ]
    return f'<div class="lead{" alone" if len(grids) < 2 else ""}">{"".join(grids)}</div>'


def _light_titles(pictures: Pictures) -> list[str]:
    """Return the titles of the light's large pictures: the confidence stands where no true light can."""
    titles = [title for title in OF_THE_LIGHT if title in pictures]
    return titles if "true light" in titles else [*titles, *({CONFIDENCE} & pictures.keys())]


def score_words(scores: dict[str, Any]) -> str:
    """Return the scores of `ORDERS` in one line."""
    return " · ".join(f"{h.name} {h.text(scores[key])}" for key, h in ORDERS.items() if key in scores)


def score_attributes(scores: dict[str, Any]) -> str:
    """Return the attributes of an element by which the page's script puts it in order."""
    return "".join(f' data-{key.replace("_", "-")}="{scores[key]:.6g}"' for key in ORDERS if key in scores)


def order_list(sections: str, all_scores: list[dict[str, Any]], of: str = "") -> str:
    """Return the list that puts the children of the element `sections` in order; nothing where there is no
    choice.
    """
    known = {key: h for key, h in ORDERS.items() if sum(key in scores for scores in all_scores) > 1}
    if not known:
        return ""
    choices = ['<option value="">as listed</option>']
    for key, heading in known.items():
        worst, best = ("up", "down") if heading.more_is_better else ("down", "up")
        name = html.escape(of + heading.name)
        choices.append(f'<option value="{_dataset(key)} {worst}">worst {name} first</option>')
        choices.append(f'<option value="{_dataset(key)} {best}">best {name} first</option>')
    listed = f'<select data-sections="{sections}">{"".join(choices)}</select>'
    return f'<p class="order" hidden><label>Order {listed}</label></p>'


def anchor(place: int) -> str:
    """Return the id of the section of a photo."""
    return f"photo-{place}"


def _dataset(key: str) -> str:
    """Return the name under which a script finds `data-...` of a score."""
    first, *rest = key.split("_")
    return first + "".join(word.capitalize() for word in rest)
