"""The evaluation as one web page that needs no other file: tables, and a row of pictures per test photo."""

import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from lightprobe.core.files import write_bytes

Rows = dict[str, dict[str, Any]]

MAX_ROWS = 32  # photos with pictures; the table has all of them

# score -> (heading, decimals, what it says)
_COLUMNS = {
    "psnr": ("PSNR", 2, "dB, full frame on white, sRGB"),
    "ssim": ("SSIM", 3, "full frame on white, sRGB"),
    "psnr_masked": ("PSNR object", 2, "dB, the object's pixels only"),
    "ssim_masked": ("SSIM object", 3, "the object's pixels only"),
    "psnr_unseen": ("PSNR unseen half", 2, "dB; light from one half of the object, scored on the other"),
    "seconds": ("seconds", 2, "time to predict the light of one photo"),
}
_LIGHT = {
    "relit_psnr": ("relit PSNR", 2, "dB; the object in other views under the predicted against the true light"),
    "relit_psnr_scaled": ("… scaled", 2, "dB, one factor per channel"),
    "diffuse_si_rmse": ("diffuse", 3, "sphere, scale-invariant RMSE of the tone-mapped light; lower is better"),
    "matte_si_rmse": ("matte", 3, "the same for a rough reflecting sphere"),
    "mirror_si_rmse": ("mirror", 3, "the same for a mirror"),
    "diffuse_angular": ("diffuse °", 1, "sphere, mean angle between colours"),
    "matte_angular": ("matte °", 1, "sphere, mean angle between colours"),
    "mirror_angular": ("mirror °", 1, "sphere, mean angle between colours"),
    "light_log_rmse": ("log-RMSE", 3, "ln radiance against the true environment, by solid angle"),
    "light_log_rmse_scaled": ("… scaled", 3, "the same after one factor"),
    "light_log_rmse_channels": ("… per channel", 3, "the same after one factor per channel"),
    "light_log_rmse_confident": ("… confident", 3, "the raw one, weighted by confidence"),
}
_TRUTH = {
    "chamfer": ("Chamfer distance", 4, "mean, both ways, in object radii"),
    "base_color_psnr": ("base colour PSNR", 2, "dB"),
    "base_color_psnr_scaled": ("… scaled", 2, "dB, one factor per channel"),
    "roughness_mae": ("roughness error", 3, "mean absolute"),
    "metallic_mae": ("metallic error", 3, "mean absolute"),
    "normal_degrees": ("normal error", 1, "degrees, mean"),
    "relight_psnr": ("relighting PSNR", 2, "dB, the object's pixels under novel lights"),
    "relight_psnr_scaled": ("… scaled", 2, "dB, one factor per channel"),
    "relight_ssim": ("relighting SSIM", 3, "the object's pixels under novel lights"),
}

_STYLE = """
:root { color-scheme: light dark; --line: #d8d8d4; --soft: #6b6b66; --back: #fbfbf9; --text: #1d1d1b; --card: #ffffff; }
@media (prefers-color-scheme: dark) {
  :root { --line: #34353a; --soft: #9a9ba3; --back: #16171a; --text: #e8e8e6; --card: #1e1f23; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1500px; padding: 2.5rem 1.5rem 4rem; background: var(--back); color: var(--text);
  font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .2rem; } h2 { font-size: 1.1rem; margin: 2.4rem 0 .6rem; }
h3 { font-size: .95rem; margin: 1.4rem 0 .4rem; } small { color: var(--soft); }
p { color: var(--soft); margin: .2rem 0 1rem; max-width: 75ch; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .35rem .9rem .35rem 0; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { font-weight: 600; } th:first-child, td:first-child { text-align: left; }
th[title] { cursor: help; }
section { background: var(--card); border: 1px solid var(--line); border-radius: 10px;
  padding: .9rem 1rem; margin: 1rem 0; }
section header { display: flex; flex-wrap: wrap; gap: .3rem 1.2rem; align-items: baseline; margin-bottom: .6rem; }
section header span { color: var(--soft); }
.row { display: grid; gap: .7rem; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); }
figure { margin: 0; } figure.wide { grid-column: span 2; }
figure img { width: 100%; display: block; border-radius: 5px; border: 1px solid var(--line); }
figcaption { color: var(--soft); font-size: .8rem; margin-top: .2rem; }
"""


def write_report(
    path: Path, metrics: dict[str, Any], pictures: dict[str, dict[str, str]], facts: dict[str, str], title: str
) -> None:
    """Write the page at `path`, atomically.

    `metrics` is the content of metrics.json, `pictures` maps photo names to data URIs by title, and `facts` are
    sentences about the run by heading.
    """
    write_bytes(path, report_page(metrics, pictures, facts, title).encode())


def report_page(metrics: dict[str, Any], pictures: dict[str, dict[str, str]], facts: dict[str, str], title: str) -> str:
    """Return the page as HTML."""
    per_photo = metrics["photos"]
    default = metrics["default_method"]
    body = [
        f"<h1>{html.escape(title)}</h1>",
        _facts(facts),
        "<h2>Light from a single photo, by method</h2>",
        "<p>The light is predicted from each test photo, the object re-rendered with it and compared with the photo. "
        f"Means over {len(per_photo)} test photos, ± the half width of their 95 % interval. Pictures and the last "
        f"table belong to <b>{html.escape(default)}</b>.</p>",
        _table("method", *_with_intervals(metrics), _COLUMNS),
        *_light_tables(metrics),
    ]
    if any(name in metrics["mean"] for name in _TRUTH):
        body += ["<h2>Against ground truth</h2>", _table("", {"object": metrics["mean"]}, {}, _TRUTH)]
    body.append("<h2>Test photos</h2>")
    body += [_photo(name, per_photo[name], pictures[name]) for name in pictures]
    body += ["<h2>Every photo</h2>", _table("photo", per_photo, {}, _COLUMNS | _LIGHT)]
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<title>{html.escape(title)}</title><style>{_STYLE}</style>"
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(body) + "\n</body></html>\n"


def spread(names: Sequence[str], limit: int = MAX_ROWS) -> list[str]:
    """Return at most `limit` of `names`, evenly spread."""
    if len(names) <= limit:
        return list(names)
    return [names[i * len(names) // limit] for i in range(limit)]


def _facts(facts: dict[str, str]) -> str:
    return "<p>" + " · ".join(f"{html.escape(k)} {html.escape(v)}" for k, v in facts.items()) + "</p>"


def _with_intervals(metrics: dict[str, Any]) -> tuple[Rows, Rows]:
    """Return the means of the methods and the half widths of their 95 % intervals."""
    return metrics["methods"], metrics.get("interval", {})


def _light_tables(metrics: dict[str, Any]) -> list[str]:
    """Return the scores of the lights and the error by confidence, or nothing where the true lights are unknown."""
    if not any(name in scores for scores in metrics["methods"].values() for name in _LIGHT):
        return []
    body = ["<h3>Against the true lights</h3>", _table("method", *_with_intervals(metrics), _LIGHT)]
    rows = {
        method: {str(i): part["log_rmse_scaled"] for i, part in enumerate(checked["bins"])}
        | {f"c{i}": part["confidence"] for i, part in enumerate(checked["bins"])}
        for method, checked in metrics.get("confidence", {}).items()
    }
    columns = {str(i): (f"fifth {i + 1}", 2, "log-RMSE after one factor") for i in range(5)}
    columns |= {f"c{i}": (f"confidence {i + 1}", 2, "mean confidence of these directions") for i in range(5)}
    return [
        *body,
        "<h3>Error by confidence</h3>",
        "<p>All directions of all photos in five parts of equal solid angle, the least confident first.</p>",
        _table("method", rows, {}, columns),
    ]


def _table(corner: str, rows: Rows, intervals: Rows, columns: dict[str, tuple[str, int, str]]) -> str:
    """Return a table with the columns that any row has; a known interval stands in the cell's title."""
    used = {key: column for key, column in columns.items() if any(key in scores for scores in rows.values())}
    head = "".join(f'<th title="{html.escape(note)}">{html.escape(name)}</th>' for name, _, note in used.values())
    lines = [
        f"<tr><td>{html.escape(name)}</td>{''.join(_cells(scores, intervals.get(name, {}), used))}</tr>"
        for name, scores in rows.items()
    ]
    table = (
        f"<table><thead><tr><th>{html.escape(corner)}</th>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"
    )
    return f'<div class="scroll">{table}</div>'


def _cells(scores: dict[str, Any], interval: dict[str, Any], columns: dict[str, tuple[str, int, str]]) -> Iterable[str]:
    for key, (_, decimals, _) in columns.items():
        if key not in scores:
            yield "<td>–</td>"
            continue
        around = f"<small> ± {interval[key]:.{decimals}f}</small>" if key in interval else ""
        yield f"<td>{scores[key]:.{decimals}f}{around}</td>"


def _photo(name: str, scores: dict[str, Any], pictures: dict[str, str]) -> str:
    notes = f"{scores['psnr_masked']:.2f} dB on the object" if "psnr_masked" in scores else ""
    figures = "".join(
        f'<figure{" class=wide" if _is_panorama(title) else ""}><img alt="{html.escape(title)}" src="{uri}">'
        f"<figcaption>{html.escape(title)}</figcaption></figure>"
        for title, uri in pictures.items()
    )
    header = f"<header><b>{html.escape(name)}</b><span>{notes}</span></header>"
    return f"<section>{header}<div class=row>{figures}</div></section>"


def _is_panorama(title: str) -> bool:
    return "light" in title or title == "confidence"  # the spheres' titles name a light, too
