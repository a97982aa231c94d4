"""The results of a benchmark as one Markdown page, from its records."""

from lightprobe.report import results_tables as tables
from lightprobe.report.bench_results import PAPER_METHOD, BenchResults
from lightprobe.report.verdict_table import verdict_table


def results_page(results: BenchResults) -> str:
    """Return the page."""
    losses_scene = next((record.scene for records in results.losses.values() for record in records), "")
    sections = [
        ("Scenes", _SCENES_NOTE, tables.scene_table(results)),
        ("Images", _IMAGES_NOTE, tables.image_table(results)),
        ("Images beside the paper's (Table 3)", _PAPER_NOTE, tables.published_images_table(results)),
        ("Light", _LIGHT_NOTE, tables.light_table(results)),
        ("Light beside published numbers", _PUBLISHED_NOTE, tables.published_lights_table(results)),
        ("The default over training seeds", _SEEDS_NOTE, tables.seed_table(results)),
        (f"The default against `{PAPER_METHOD}`", _DEFAULT_NOTE, tables.comparison_table(results)),
        ("What Phase II learns from", _LESSONS_NOTE, tables.lessons_table(results)),
        ("Against slow methods, on the same few photos", _SLOW_NOTE, tables.slow_table(results)),
        ("The object", _OBJECT_NOTE, tables.object_table(results)),
        ("What was said of the object beforehand", _VERDICT_NOTE, verdict_table(results)),
        ("Error by confidence", _CONFIDENCE_NOTE, tables.confidence_table(results)),
        ("Seconds per photo (Table 4)", _TIME_NOTE, tables.time_table(results)),
        (
            "Weights of the loss (Table 5), and r² against r⁴",
            _loss_note(losses_scene),
            tables.loss_table(results),
        ),
        ("How each record was made", _RECORDS_NOTE, tables.record_table(results)),
    ]
    lines = ["# Results", "", _HEAD, "", *_about(results)]
    if results.missing:
        lines += ["", *(f"**Missing:** {sentence}" for sentence in results.missing)]
    for title, note, table in sections:
        if table:
            lines += ["", f"## {title}", "", note, "", *table]
    return "\n".join(lines) + "\n"


def _about(results: BenchResults) -> list[str]:
    """Return what the records have in common, or all that they have."""
    wanted = {"commit": "commit", "machine": "machine", "threads": "threads", "preset": "preset"}
    found = {
        name: dict.fromkeys(getattr(record, key) for record in results.records if getattr(record, key))
        for name, key in wanted.items()
    }
    lines = [f"- {name}: {' and '.join(values)}" for name, values in found.items() if values]
    return [*lines, "- records of several commits: each row tells its own"] if results.mixed else lines


def _loss_note(scene: str) -> str:
    return (
        f"`{PAPER_METHOD}` on {scene}: one Phase I, Phase II trained anew for every loss and seed. "
        "Means, ± the half width of the 95 % interval over seeds (Student's t)."
    )


_HEAD = (
    "Written by `lightprobe bench` from the records in `records/`, one small file for every evaluation; what is said "
    "about the numbers stands in docs/decisions. Means over test photos come with ± the half width of their 95 % "
    "interval. Photos under one environment are no independent evidence, so lights are the unit: Student's t with one "
    "degree of freedom less than there are lights (see Scenes), and a standard error that takes the photos under one "
    "light together; where the lights have no names, every photo is taken for a light of its own. These intervals are "
    "for the run at hand; what other seeds of the training do stands in a table of its own, where there are such runs."
)
_SCENES_NOTE = (
    "What each scene was used for. Numbers of development scenes are of photos that settings were chosen by, and "
    "flatter us; those of untouched scenes and of your own do not."
)
_IMAGES_NOTE = (
    "Protocol A: the light is predicted from the whole test photo and the object rendered under it; sRGB, composited "
    "on white. Unseen is protocol B: the light from one half of the object's pixels, scored on the other, mean of four "
    f"splits. `{PAPER_METHOD}` is the paper's network; *{PAPER_METHOD}, quick* was trained with the preset quick's "
    "Phase I, losses, steps and lessons, which are not the paper's. Rows named *paper's settings* come from a run of "
    "its own with the preset paper and as many of the paper's iterations as the row says. Methods scored on a part of "
    "the photos have a table of their own below."
)
_PAPER_NOTE = (
    "Full frame, PSNR and SSIM. The paper tells neither its test photos nor what stands behind the object; ours are "
    "every 16th photo, composited on white, at the photos' full size. All of the paper's tables stand in "
    "docs/paper-tables.md."
)
_LIGHT_NOTE = (
    "Relit: the object (the true one where the scene brings it) in other views under the predicted against the true "
    "light, PSNR of its pixels, raw and after one factor per channel. Diffuse, matte, mirror: three-sphere si-RMSE and "
    "mean angle. Log-RMSE of radiance by solid angle, raw, after one factor, after one per channel; brightest: over "
    "the brightest percent of the true light's solid angle alone, raw and after the whole map's one factor. *True "
    "object*: the scene's own mesh and material in place of the reconstructed ones; the learned methods keep the model "
    "of the training that the last table names for these rows, which can be an earlier one than the run's."
)
_PUBLISHED_NOTE = (
    "The three spheres (si-RMSE and mean angle) in the mean of all scenes whose true lights are known, beside "
    "published ones. The measure is the same; photos, lights and what is known beforehand are not, so the rows tell "
    "where ours stands, not which method is better."
)
_SEEDS_NOTE = (
    "Both phases trained anew with every seed, the default method on all test photos: mean over seeds ± the half width "
    "of its 95 % interval over seeds (Student's t), and the least and the largest."
)
_DEFAULT_NOTE = (
    f"The default of the run against `{PAPER_METHOD}`: trained with the preset quick on the same lessons, on photos "
    "alone, and in a run of its own with the paper's settings and the stated part of its iterations. Only the last is "
    "the paper's method, and only with all its iterations its result. Gains in dB; ratios of three-sphere si-RMSE and "
    "differences of log-RMSE, where less than 1 and less than 0 are better."
)
_LESSONS_NOTE = (
    "Other Phases II on the same Phase I. *As trained*: on photos under their lights from Phase I and on re-rendered "
    "ones, under those lights turned, tinted and mixed and under generated ones. *Photos alone*: the paper's kind of "
    "lessons. *Re-rendered alone*: without the photos. *With HDRIs*: as trained, but about half of the re-rendered "
    "photos lit by the environment maps of a folder."
)
_SLOW_NOTE = (
    "Methods that take more than 20 s a photo are scored on the first photos only, as many as the row says, and the "
    "default beside them on the same ones. So few photos carry no interval."
)
_OBJECT_NOTE = (
    "Base colour over truth: ratio of the mean linear base colours over all pixels that both objects cover, geometric "
    "mean over channels, and the channel that is farthest from 1. Base colour in dB, raw and after one factor per "
    "channel. Relighting: the object under the scene's novel lights against its renders, PSNR and SSIM of its pixels, "
    "raw and after one factor per channel. The rows of true objects show what is left to the renderer."
)
_VERDICT_NOTE = (
    "The verdict of training on its object, from held-out photos alone (docs/decisions/object-verdict.md), beside what "
    "truth says: disagreement of darker and brighter parts about the light, surprise at where the lights come from in "
    "ln probability, relighting after one factor per channel as it was expected and as it was found, and the mean "
    "si-RMSE of the three spheres under the default's maps, as simulated photos of the object let expect, whose lights "
    "are coarser (docs/decisions/light-accuracy.md), and as it was found. Beside both stands what the true object "
    "comes to: more cannot be expected of any. How bright the object is as a whole the verdict hardly sees."
)
_CONFIDENCE_NOTE = (
    "All directions of all test photos in five parts of equal solid angle by confidence: log-RMSE after one factor per "
    "photo (raw in brackets)."
)
_TIME_NOTE = (
    "Prediction of one photo, in process, assets loaded, in the mean of the photos that the method saw; training of "
    "the run, and the most memory, as its log has it."
)
_RECORDS_NOTE = (
    "Commit: what evaluated; trained at: what trained, where the benchmark did that itself. DATA stands for the folder "
    "of the scenes, RUNS for that of the runs, FOLDER for the benchmark's own, HDRI for the environment maps. "
    "`lightprobe bench --tables-only --results` with this page's name writes it from the records."
)
