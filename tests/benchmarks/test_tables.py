import itertools

from benchmarks.record import Kind
from benchmarks.results import BenchResults
from benchmarks.tables import (
    comparison_table,
    confidence_table,
    image_table,
    lessons_table,
    light_table,
    loss_table,
    object_table,
    published_images_table,
    published_lights_table,
    record_table,
    results_page,
    scene_table,
    seed_table,
    slow_table,
    time_table,
)
from tests.benchmarks.records import metrics, record, spheres

CUT = "1500 of 40 000 + 2000 of 30 000"


def real(psnr: float = 24.0) -> dict:
    scores = {"net": {"psnr": psnr, "ssim": 0.8}, "probe-mlp": {"psnr": psnr - 2}}
    mean = {"psnr": psnr}
    return {
        "methods": scores,
        "default_method": "net",
        "mean": mean,
        "interval": {},
        "confidence": {},
        "photos": {"a": {"methods": scores}},
    }


def benchmark(*others) -> BenchResults:
    losses = [
        record(
            "cup", Kind.LOSS, {"methods": {"probe-mlp": {"psnr": value, **spheres(0.3)}}}, label="L2", seed=i
        )
        for i, value in enumerate((1.0, 2.0, 3.0))
    ]
    runs = [
        record("cup", training={"decompose": 601.0}),
        record("pot", scored=metrics(2.0)),
        record("cape", scored=real()),
    ]
    return BenchResults(
        [*runs, record("cup", Kind.ORACLE, metrics(1.0)), *losses, *others], ["bottle, no numbers."]
    )


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("|")[1:-1]]


def test_rows_hold_means_with_intervals_and_true_objects_follow_their_scene():
    images = [cells(line) for line in image_table(benchmark())[2:]]
    assert images[0] == ["cup", "net", "30.00 ± 1.25", ".900", "25.00", "–", "21.00"]
    assert images[-2] == ["cape", "net", "24.00", ".800", "–", "–", "–"]
    names = [cells(line)[0] for line in light_table(benchmark())[2:]]
    assert names == ["cup"] * 2 + ["cup, true object"] * 2 + ["pot"] * 2  # cape's light is not known


def test_the_paper_s_method_is_named_by_what_it_was_trained_with():
    """Trained as the default is, it is not the paper's; beside it stands a run that is, with its share of the
    steps.
    """
    results = benchmark(record("cup", Kind.PAPER, preset="paper", iterations=CUT))
    methods = [cells(line)[1] for line in image_table(results)[2:] if cells(line)[0] == "cup"]
    assert methods == [
        "net",
        "probe-mlp, quick",
        f"net, paper's settings, {CUT} iterations",
        f"probe-mlp, paper's settings, {CUT} iterations",
    ]
    assert "probe-mlp, quick" in results_page(results)
    assert "| probe-mlp |" not in results_page(results)
    assert cells(comparison_table(results)[-1])[:2] == ["cup", f"paper's settings, {CUT} iterations"]


def test_methods_that_saw_some_photos_stand_in_a_table_without_intervals():
    assert not any("slow" in line for line in (*image_table(benchmark()), *confidence_table(benchmark())))
    rows = slow_table(benchmark())[2:]
    assert cells(rows[0])[:3] == ["cup", "net (1 photo)", "25.00"]  # not photo b
    assert cells(rows[1])[:4] == ["cup", "slow (1 photo)", "24.00", "–"]
    assert not any("±" in row for row in rows)


def test_every_scene_tells_what_it_was_used_for():
    rows = {cells(line)[0]: cells(line)[1:] for line in scene_table(benchmark())[2:]}
    assert rows["cup"] == ["yours: not used in development", "2", "1"]
    assert rows["kettle"][0].startswith("untouched")
    assert rows["kettle"][1] == "**not yet scored**"
    assert rows["cape"] == ["development: looked at while settings were chosen", "1", "not named"]
    assert list(rows)[:2] == ["kettle", "figure"]


def test_gains_are_named_after_what_they_were_measured_against():
    rows = [cells(line) for line in comparison_table(benchmark())]
    assert rows[2] == [
        "cup",
        "quick, as trained",
        "+0.00",
        "+0.00",
        "+3.00",
        "+0.00",
        *["0.50"] * 3,
        "+0.00",
        "–",
    ]
    assert rows[-1][:5] == ["**mean**", "quick, as trained", "+0.00", "+1.00", "+4.00"]


def test_the_papers_method_also_counts_with_other_lessons():
    results = with_lessons()
    other = next(r for r in results.records if r.label == "photos alone")
    other.metrics["methods"]["probe-mlp"]["relit_psnr_scaled"] += 0.5
    rows = comparison_table(results)
    assert rows[:5] == comparison_table(benchmark())
    assert [cells(row)[:5] for row in rows[5:]] == [["cup", "quick, photos alone", "+0.00", "-0.50", "+3.00"]]


def with_lessons() -> BenchResults:
    every = (("photos alone", "cup", -1.0), ("with HDRIs", "cup", 3.0), ("with HDRIs", "pot", 5.0))
    records = [record(scene, Kind.LESSONS, metrics(gain), label=label) for label, scene, gain in every]
    for each in records:
        del each.metrics["methods"]["slow"]
    return benchmark(*records)


def test_lessons_stand_side_by_side_for_each_method_that_learned_from_them():
    rows = [cells(line)[:4] for line in lessons_table(with_lessons())[2:]]
    assert rows[:3] == [
        ["cup", "net", "as trained", "25.00"],
        ["cup", "net", "photos alone", "24.00"],
        ["cup", "net", "with HDRIs", "28.00"],
    ]
    assert [row[1] for row in rows[3:6]] == ["probe-mlp, quick"] * 3
    assert [row[2] for row in rows if row[0] == "pot"] == ["as trained", "with HDRIs"] * 2
    assert {row[0] for row in rows} == {"cup", "pot"}  # the cape was trained once
    assert lessons_table(benchmark()) == []


def test_spheres_stand_beside_all_published_ones_in_the_mean_of_all_scenes_with_true_lights():
    cup = metrics()
    cup["methods"]["net"].update(spheres(0.3))
    results = BenchResults([record("cup", scored=cup), record("chair"), record("cape", scored=real())])
    rows = [cells(line) for line in published_lights_table(results)[2:]]
    assert rows[0][:4] == ["ours, default", ".200", ".200", ".200"]
    assert rows[0][-1].startswith("mean of cup, chair;")
    assert rows[1][:2] == ["ours, probe-mlp, quick", ".200"]
    assert [row[:4] for row in rows[2:]] == [
        ["LuxDiT", ".077", ".196", ".442"],
        ["NeuS + Mitsuba", ".082", ".232", ".424"],
        ["DiffusionLight", ".113", ".270", ".519"],
    ]
    assert all(row[-1] for row in rows)
    assert published_lights_table(BenchResults([record("cape", scored=real())])) == []


def test_images_stand_beside_those_of_the_paper():
    rows = [cells(line) for line in published_images_table(benchmark())[2:]]
    assert rows == [
        ["cape", "the paper, as published", "23.98", ".85"],
        ["cape", "ours, net", "24.00", ".800"],
        ["cape", "ours, probe-mlp, quick", "22.00", "–"],
    ]


def test_seeds_of_the_default_have_an_interval_and_a_range():
    results = benchmark(
        record("cape", Kind.SEED, real(26.0), seed=1), record("cape", Kind.SEED, real(25.0), seed=2)
    )
    rows = seed_table(results)
    assert cells(rows[2])[:3] == ["cape", "0, 1, 2", "25.00 ± 2.48 (24.00 to 26.00)"]  # t(.975, 2) / sqrt(3)
    assert len(rows) == 3  # the others have one seed
    assert seed_table(benchmark()) == []


def test_seeds_of_a_loss_have_an_interval():
    row = loss_table(benchmark())[2]
    assert row.startswith("| L2 | 3 | 2.00 ± 2.48 |")
    assert ".3000 ± .0000" in row


def test_confidence_object_and_time():
    confidence = confidence_table(benchmark())
    assert confidence[2].startswith("| cup | net | 1.50 (2.00) |")
    assert confidence[2].endswith("| 0.00 to 0.40 | yes |")
    assert confidence[3].endswith("**no** |")
    objects = [cells(row) for row in object_table(benchmark())[2:]]
    assert [row[:2] for row in objects] == [["cup", ".80"], ["pot", ".80"], ["cup, true object", ".80"]]
    times = time_table(benchmark())
    assert times[2] == "| cup | .90 | .05 | 90.00 | 601 | – | – |"


def test_each_row_tells_its_commit_where_these_differ():
    assert not any("commit" in table(benchmark())[0] for table in (image_table, light_table, object_table))
    results = benchmark(record("pot", Kind.ORACLE, commit="def"))
    assert [cells(line)[-1] for line in light_table(results)[2:]] == ["abc"] * 6 + ["def"] * 2
    assert cells(light_table(results)[0])[-1] == "commit"
    assert "- commit: abc and def" in results_page(results)
    assert {cells(line)[1] for line in record_table(results)[2:]} == {"abc", "def"}


def test_raw_scores_stand_beside_scaled_ones_in_every_table_that_has_them():
    results = benchmark(record("cup", Kind.SEED, seed=1), *with_lessons().records)
    for table in (
        light_table,
        seed_table,
        comparison_table,
        lessons_table,
        slow_table,
        object_table,
        loss_table,
    ):
        head = cells(table(results)[0])
        scaled = [i for i, name in enumerate(head) if name.startswith("scaled")]
        assert scaled
        assert all("raw" in head[i - 1] for i in scaled)


def test_the_page_names_what_is_missing_and_survives_having_nothing():
    page = results_page(with_lessons())
    assert "**Missing:** bottle, no numbers." in page
    lines = page.splitlines()
    for previous, line in itertools.pairwise(lines):
        if line.startswith("| ---"):
            assert previous.count("|") == line.count("|")
    assert "## Images" not in results_page(BenchResults())
    assert "**not yet scored**" in results_page(BenchResults())
