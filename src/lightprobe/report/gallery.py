"""Many runs on one page: a card with pictures and scores for each, and a table that sorts.

The picture of a run is that of its middling photo, by the object's PSNR: neither the best one nor the worst.
"""

import html
from urllib.parse import quote

from lightprobe.report.headings import IMAGES, LIGHTS, OBJECT
from lightprobe.report.page import figure, web_page
from lightprobe.report.photo_section import ORDERS, order_list, score_attributes, score_words
from lightprobe.report.pictures import OF_THE_LIGHT, OF_THE_VIEW
from lightprobe.report.report import Report
from lightprobe.report.report_tables import table

GALLERY = "<!-- lightprobe gallery -->"  # by which its page is known
_ORDER = "psnr_masked"


def gallery_page(reports: dict[str, Report], title: str = "lightprobe: runs") -> str:
    """Return the page of runs by name as HTML; it links to NAME/index.html beside it."""
    means = {name: report.metrics["mean"] for name, report in reports.items()}
    cards = [_card(name, report, place) for place, (name, report) in enumerate(reports.items())]
    anchors = {name: f"run-{place}" for place, name in enumerate(reports)}
    return web_page(
        title,
        [
            f"{GALLERY}<h1>{html.escape(title)}</h1>",
            f"<p>Runs: {len(reports)}. Each shows its middling test photo: the photo, the object under the light "
            "predicted from it, that light, and what it makes of three spheres.</p>",
            order_list("runs", list(means.values())),
            f'<div id="runs" class="cards">{"".join(cards)}</div>',
            "<h2>Means over each run's test photos</h2>",
            "<p>By the method that each card names: the run's default, unless it was evaluated with others alone. A "
            "click on a heading sorts.</p>",
            table("run", means, IMAGES | LIGHTS | OBJECT, anchors=anchors),
        ],
    )


def middling_photo(report: Report) -> str | None:
    """Return the photo with pictures whose score is the median, or None where there are no pictures."""
    photos = report.metrics["photos"]
    names = sorted(report.pictures, key=lambda name: photos[name].get(_ORDER, 0.0))
    return names[len(names) // 2] if names else None


def _card(name: str, report: Report, place: int) -> str:
    mean, photo = report.metrics["mean"], middling_photo(report)
    address = html.escape(f"{quote(name)}/index.html")
    method = html.escape(report.metrics["default_method"])
    header = f'<header><b><a href="{address}">{html.escape(name)}</a></b><span>{method}</span><span></span></header>'
    body = ""
    if photo is not None:
        pictures = report.pictures[photo]
        for kind, titles in (("views", OF_THE_VIEW), ("light", OF_THE_LIGHT[:2])):
            shown = (figure(title, pictures[title]) for title in titles if title in pictures)
            body += f'<div class="{kind}">{"".join(shown)}</div>'
    words = f"<p>{html.escape(score_words(mean))}</p>" if any(key in mean for key in ORDERS) else ""
    attributes = score_attributes(mean)
    return f'<section id="run-{place}" data-place="{place}"{attributes}>{header}{body}{words}</section>'
