import itertools

from lightprobe.evaluate.results import (
    BenchResults,
    comparison_table,
    confidence_table,
    image_table,
    lessons_table,
    light_table,
    loss_table,
    object_table,
    published_table,
    results_page,
    slow_table,
    time_table,
)

LIGHT = {"relit_psnr": 20.0, "relit_psnr_scaled": 25.0, "light_log_rmse": 1.0, "psnr_unseen": 21.0}


def spheres(value: float) -> dict[str, float]:
    return {f"{s}_si_rmse": value for s in ("diffuse", "matte", "mirror")}


def metrics(gain: float = 0.0) -> dict:
    default = {"psnr": 30.0, "ssim": 0.9, "psnr_masked": 25.0 + gain, "seconds": 0.9, **LIGHT, **spheres(0.1)}
    default["relit_psnr_scaled"] += gain
    paper = {"psnr": 27.0, "ssim": 0.8, "psnr_masked": 22.0, "seconds": 0.05, **LIGHT, **spheres(0.2)}
    slow = {"psnr_masked": 24.0, "seconds": 90.0}
    parts = [{"confidence": 0.1 * i, "log_rmse": 2.0 - 0.1 * i, "log_rmse_scaled": 1.5 - 0.1 * i} for i in range(5)]
    return {
        "mean": {**default, "chamfer": 0.0123, "relight_psnr": 19.0},
        "interval": {"net": {"psnr": 1.25}},
        "default_method": "net",
        "methods": {"net": default, "probe-mlp": paper, "slow": slow},
        "confidence": {"net": {"bins": parts, "falls": True}, "probe-mlp": {"bins": parts[::-1], "falls": False}},
        "photos": {
            "a": {"methods": {"net": default, "probe-mlp": paper, "slow": slow}},
            "b": {"methods": {"net": {**default, "psnr_masked": 99.0}, "probe-mlp": paper}},
        },
    }


def benchmark() -> BenchResults:
    real = {"methods": {"net": {"psnr": 24.0}}, "default_method": "net", "mean": {"psnr": 24.0}, "photos": {}}
    losses = [{"methods": {"probe-mlp": {"psnr": value, **spheres(0.3)}}} for value in (1.0, 2.0, 3.0)]
    return BenchResults(
        {"commit": "abc"}, {"cup": metrics(), "pot": metrics(2.0), "cape": real}, {"cup": metrics(1.0)},
        {"cup": {"decompose": 601.0}}, {"L2": losses}, "cup", ["lightprobe train cup"], ["bottle, no numbers."],
    )  # fmt: skip


def test_rows_hold_means_with_intervals_and_true_objects_follow_their_scene():
    images = image_table(benchmark())
    assert images[2] == "| cup | net | 30.00 ± 1.25 | .900 | 25.00 | – | 21.00 |"
    assert images[-1] == "| cape | net | 24.00 | – | – | – | – |"
    names = [line.split("|")[1].strip() for line in light_table(benchmark())[2:]]
    assert names == ["cup"] * 3 + ["cup, true object"] * 3 + ["pot"] * 3  # cape's light is not known


def test_gains_over_the_papers_method_per_scene_and_in_the_mean():
    rows = comparison_table(benchmark())
    assert rows[2] == "| cup | as trained | +0.00 | +3.00 | +0.00 | 0.50 | 0.50 | 0.50 |"
    assert rows[-1].startswith("| **mean** | as trained | +1.00 | +4.00 |")


def test_the_papers_method_also_counts_with_the_papers_lessons():
    results = with_lessons()
    results.lessons["photos alone"]["cup"]["methods"]["probe-mlp"]["relit_psnr_scaled"] += 0.5
    rows = comparison_table(results)
    assert rows[:5] == comparison_table(benchmark())
    assert rows[5:] == ["| cup | photos alone | -0.50 | +3.00 | +0.00 | 0.50 | 0.50 | 0.50 |"]


def with_lessons() -> BenchResults:
    results = benchmark()
    results.lessons = {"photos alone": {"cup": metrics(-1.0)}, "with HDRIs": {"cup": metrics(3.0), "pot": metrics(5.0)}}
    for scenes in results.lessons.values():
        for scored in scenes.values():
            del scored["methods"]["slow"]
    return results


def test_lessons_stand_side_by_side_for_each_method_that_learned_from_them():
    rows = [[cell.strip() for cell in line.split("|")[1:5]] for line in lessons_table(with_lessons())[2:]]
    assert rows[:3] == [
        ["cup", "net", "as trained", "25.00"],
        ["cup", "net", "photos alone", "24.00"],
        ["cup", "net", "with HDRIs", "28.00"],
    ]
    assert [row[1] for row in rows[3:6]] == ["probe-mlp"] * 3
    assert [row[2] for row in rows if row[0] == "pot"] == ["as trained", "with HDRIs"] * 2
    assert {row[0] for row in rows} == {"cup", "pot"}  # the cape was trained once
    assert lessons_table(benchmark()) == []


def test_spheres_beside_published_numbers_need_both_scenes():
    spot, bottle = metrics(), metrics()
    for scene, angle in ((spot, 2.0), (bottle, 4.0)):
        scene["methods"]["net"].update({f"{s}_angular": angle for s in ("diffuse", "matte", "mirror")})
        scene["methods"]["constant"] = spheres(0.4)
    bottle["methods"]["net"].update(spheres(0.2))
    results = BenchResults({}, {"spot": spot, "bottle": bottle}, {"spot": spot})
    rows = published_table(results)[2:]
    assert rows[0] == "| default, own object | .150 | .150 | .150 | 3.0 | 3.0 | 3.0 |"
    assert rows[1] == "| constant map | .400 | .400 | .400 | – | – | – |"
    assert rows[2] == "| best published | .077 | .196 | .442 | – | – | – |"
    results.oracle["bottle"] = bottle
    labels = [row.split("|")[1].strip() for row in published_table(results)[2:4]]
    assert labels == ["default, own object", "default, true object"]
    assert published_table(benchmark()) == []


def test_a_slow_method_is_compared_on_its_own_photos():
    rows = slow_table(benchmark())[2:]
    assert rows[0].startswith("| cup | net (1 photos) | 25.00 |")  # not photo b
    assert rows[1].startswith("| cup | slow (1 photos) | 24.00 | – |")


def test_seeds_of_a_loss_have_an_interval():
    row = loss_table(benchmark())[2]
    assert row.startswith("| L2 | 3 | 2.00 ± 2.48 |")  # t(.975, 2) / sqrt(3)
    assert ".3000 ± .0000" in row


def test_confidence_object_and_time():
    confidence = confidence_table(benchmark())
    assert confidence[2].startswith("| cup | net | 1.50 (2.00) |")
    assert confidence[2].endswith("| 0.00 to 0.40 | yes |")
    assert confidence[3].endswith("**no** |")
    assert [row.split("|")[1].strip() for row in object_table(benchmark())[2:]] == ["cup", "pot", "cup, true object"]
    times = time_table(benchmark())
    assert times[2] == "| cup | .90 | .05 | 90.00 | 601 | – | – |"


def test_the_page_names_what_is_missing_and_survives_having_nothing():
    page = results_page(with_lessons())
    assert "**Missing:** bottle, no numbers." in page
    assert "    lightprobe train cup" in page
    lines = page.splitlines()
    for previous, line in itertools.pairwise(lines):
        if line.startswith("| ---"):
            assert previous.count("|") == line.count("|")
    assert "## Images" not in results_page(BenchResults({}))
