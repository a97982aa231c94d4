"""Many runs on one page: a card with pictures and scores for each, and a table that sorts.

The picture of a run is that of its middling photo, by the object's PSNR: neither the best one nor the worst.
"""

from urllib.parse import quote

from lightprobe.report import html
from lightprobe.report.headings import IMAGES, LIGHTS, OBJECT
from lightprobe.report.pictures import OF_THE_LIGHT
from lightprobe.report.report import Report

GALLERY = "<!-- lightprobe gallery -->"  # by which its page is known


def gallery_page(reports: dict[str, Report], title: str = "lightprobe: runs") -> str:
    """Return the page of runs by name as HTML; it links to NAME/index.html beside it."""
    means = {name: report.metrics["mean"] for name, report in reports.items()}
    cards = [
        {
            "name": name,
            "address": f"{quote(name)}/index.html",
            "method": report.metrics["default_method"],
            "mean": means[name],
            "pictures": report.pictures.get(middling_photo(report) or "", {}),
        }
        for name, report in reports.items()
    ]
    anchors = {name: f"run-{place}" for place, name in enumerate(reports)}
    return html.fill(
        "gallery.html",
        title=title,
        cards=cards,
        choices=html.order_choices(means.values()),
        light=OF_THE_LIGHT[:2],
        means=html.table("run", means, IMAGES | LIGHTS | OBJECT, anchors=anchors),
    )


def middling_photo(report: Report) -> str | None:
    """Return the photo with pictures whose score is the median, or None where there are no pictures."""
    photos = report.metrics["photos"]
    names = sorted(report.pictures, key=lambda name: photos[name].get("psnr_masked", 0.0))
    return names[len(names) // 2] if names else None
