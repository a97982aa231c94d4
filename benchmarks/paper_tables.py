"""The page that sets every table and figure of the paper beside ours, with the commands that make ours."""

from collections.abc import Sequence

from benchmarks.markdown import NONE, markdown_table, mean, number
from benchmarks.published import PAPER_LOSSES, PAPER_SECONDS, PAPER_TABLES, PaperTable, Scores
from benchmarks.record import Record
from benchmarks.results import PAPER_METHOD, BenchResults, method_name

_NOT_RUN = "not run"


def paper_page(results: BenchResults) -> str:
    """Return the page."""
    lines = ["# The paper's tables", "", _HEAD, "", *_OTHER_SCENES]
    for table in PAPER_TABLES:
        folders = " ".join(table.scenes.values())
        lines += ["", f"## Table {table.number}: {table.title}", ""]
        lines += [*_command(f"--scenes {folders} {_STEPS}"), ""]
        lines += _image_rows(table, results)
    lines += ["", "## Table 4: seconds to predict the light of one image", "", _TIME_NOTE, ""]
    lines += [*_command("--scenes spot cape --steps run"), "", *_time_rows(results)]
    lines += ["", "## Table 5: losses of Phase II", "", _LOSS_NOTE, ""]
    lines += [*_command("--scenes chair --steps run losses"), "", *_loss_rows(results)]
    lines += ["", "## Figures", "", *markdown_table(("figure", "what it shows", "ours", "command"), _FIGURES)]
    lines += ["", "## Numbers in the text", "", *markdown_table(("the paper", "ours", "command"), _TEXT)]
    return "\n".join(lines) + "\n"


def _image_rows(table: PaperTable, results: BenchResults) -> list[str]:
    """Return a table of images: the published rows, and ours on the scenes that were scored."""
    names = list(table.scenes)
    rows = [[method, *map(_cell, scores)] for method, scores in table.rows.items()]
    kinds = {
        "ours, default": (results.runs, None),
        f"ours, {PAPER_METHOD}, preset of the run": (results.runs, PAPER_METHOD),
        f"ours, {PAPER_METHOD}, paper's settings": (results.paper, PAPER_METHOD),
    }
    cut = []
    for label, (records, method) in kinds.items():
        ours = [_ours(records.get(folder), method) for folder in table.scenes.values()]
        rows.append([label, _average(ours), *map(_cell, ours)])
        found = [records[folder] for folder in table.scenes.values() if folder in records]
        cut += [f"{r.scene}: {method_name(PAPER_METHOD, r)}." for r in found if r.iterations]
    lines = markdown_table(["method", "average", *names], rows)
    absent = [name for name, folder in table.scenes.items() if folder not in results.runs]
    if absent:
        lines += ["", f"*{_NOT_RUN}*: {', '.join(absent)}, not distributed with this project; see above."]
    return lines + (["", *cut] if cut else [])


def _ours(record: Record | None, method: str | None) -> Scores | None:
    if record is None:
        return (_NOT_RUN, "")
    scores = record.metrics["methods"].get(method or record.metrics["default_method"], {})
    return (number(scores["psnr"], 2), number(scores["ssim"], 3)) if "psnr" in scores else (_NOT_RUN, "")


def _average(scores: Sequence[Scores | None]) -> str:
    """Return the average where every scene of the table has a value; that of fewer would be another table's."""
    known = [each for each in scores if each is not None and each[1]]
    if len(known) < len(scores):
        return NONE
    psnr, ssim = (mean([float(each[i]) for each in known]) for i in (0, 1))
    return _cell((number(psnr, 2), number(ssim, 3)))


def _cell(scores: Scores | None) -> str:
    """Return PSNR and SSIM in one cell."""
    return NONE if scores is None else " / ".join(filter(None, scores))


def _time_rows(results: BenchResults) -> list[str]:
    rows = [[method, seconds, steps, NONE] for method, (seconds, steps) in PAPER_SECONDS.items()]
    for records in (results.runs, results.paper):
        for scene, record in records.items():
            scores = record.metrics["methods"]
            place = f"{scene}; {record.machine}; {record.threads} thread(s)"
            for method in dict.fromkeys((record.metrics["default_method"], PAPER_METHOD)):
                if method in scores:
                    seconds = number(scores[method].get("seconds"), 2)
                    steps = "1" if method == PAPER_METHOD else NONE
                    rows.append([f"ours, {method_name(method, record)}", seconds, steps, place])
    if not results.runs:
        rows.append(["ours", _NOT_RUN, NONE, NONE])
    return markdown_table(["method", "seconds", "steps", "scene and machine"], rows)


def _loss_rows(results: BenchResults) -> list[str]:
    rows = []
    for loss in dict.fromkeys([*PAPER_LOSSES, *results.losses]):
        each = [record.metrics["methods"][PAPER_METHOD] for record in results.losses.get(loss, [])]
        shown = (("psnr", 2), ("ssim", 4)) if each else ()
        ours = [number(mean([m[key] for m in each]), d) for key, d in shown] or [_NOT_RUN]
        rows.append([loss, _cell(PAPER_LOSSES.get(loss)), " / ".join(ours), str(len(each) or NONE)])
    return markdown_table(["loss", "the paper, NeRD's Chair", "ours, our chair", "seeds"], rows)


def _command(options: str) -> list[str]:
    return [f"    python -m benchmarks run --data DATA {options}"]


_STEPS = "--steps run paper --paper-iterations 40000 30000"
_HEAD = (
    "Written by `python -m benchmarks tables --paper` from the records, beside benchmarks/RESULTS.md. PSNR in dB / SSIM, full frame. "
    '*The paper\'s* is the row that the paper calls "Ours", as printed there; the rows called *ours* were measured '
    "with this program. Ours: the light is predicted from the whole test photo, the object rendered under it at the "
    "photo's full size on white; test photos are the scene's own list, or every 16th photo. The paper tells neither "
    "its test photos nor what stands behind the object. `probe-mlp` is the paper's method only with the paper's "
    "settings (`--preset paper`), and only with all its iterations, 40 000 of Phase I and 30 000 of Phase II; rows "
    "of shorter runs say how many they had."
)
_OTHER_SCENES = [
    "## Scenes that are not distributed with this project",
    "",
    "None of NeRD's scenes is: Car, Chair and Globe (synthetic), Gnome, MotherChild, Head and Cape (real) come from "
    "that project's authors, under their licences. Who has them puts each into a folder of its own, or a link to it, "
    "named as below (`chair` is another object, one of this project's synthetic scenes):",
    "",
    "    DATA/nerd-car   DATA/nerd-chair        DATA/nerd-globe",
    "    DATA/nerd-gnome DATA/nerd-motherchild  DATA/nerd-head   DATA/cape",
    "",
    "The real ones are in NeRD's own layout (`poses_bounds.npy`, `images/`, `masks/`), which is read as it is. "
    "Synthetic ones in Blender's layout (`transforms_train.json`, `transforms_test.json`) need the mask as the photos' "
    "alpha channel or `mask_path`. Then, scene by scene,",
    "",
    "    lightprobe inspect DATA/nerd-car",
    f"    python -m benchmarks run --data DATA --scenes nerd-car {_STEPS}",
    "",
    "where the second command needs a GPU, or smaller numbers behind `--paper-iterations`. Both the program's default "
    "and the paper's method then stand in RESULTS.md and on this page, under the scene's name.",
]
_TIME_NOTE = "The paper does not name the machine of its table; our rows name theirs. Loading is not counted."
_LOSS_NOTE = (
    "The paper's ablation is on NeRD's Chair, which this project does not have. Ours is on its own synthetic chair, "
    "with the preset of the run on photos alone, in the mean over seeds, so that only differences between rows can be "
    "compared. RESULTS.md has intervals and the errors of the lights."
)
_FIGURES = (
    ("1", "overview of Phase I", "CONTRIBUTING.md, Layout", NONE),
    ("2", "overview of Phase II", "CONTRIBUTING.md, Layout", NONE),
    (
        "3",
        "decomposition of NeRD's Car",
        f"{_NOT_RUN}: scene not distributed with this project; RUN/report/index.html shows photo, render, base "
        "colour, roughness, metallic, normals and light of every test photo",
        "`lightprobe eval RUNS/nerd-car`",
    ),
    (
        "4",
        "novel views of the Gold Cape",
        "RUN/report/index.html of the cape; its photos are not ours to publish",
        "`lightprobe eval RUNS/cape`",
    ),
)
_TEXT = (
    (
        "both phases within 3 hours on one GTX 1080 Ti (section 4.2)",
        "shortened runs: RESULTS.md, Seconds per photo; a full run projected: paper-preset.md, What it costs; "
        "never measured on that card",
        "`lightprobe train SCENE -o RUN --preset paper`",
    ),
    ("Neural-PIL: 22 hours on four RTX 2080 Ti", f"{_NOT_RUN}: another project", NONE),
)
