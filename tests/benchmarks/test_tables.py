import itertools

from benchmarks.paper_tables import paper_page
from benchmarks.record import Kind, Record
from benchmarks.results import BenchResults
from benchmarks.tables import (
    comparison_table,
    confidence_table,
    image_table,
    lessons_table,
    light_table,
    loss_table,
    object_table,
    record_table,
    results_page,
    seed_table,
    slow_table,
    verdict_table,
)
from lightprobe.models import LightAccuracy, ObjectVerdict
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


def test_methods_that_saw_some_photos_stand_in_a_table_without_intervals():
    assert not any("slow" in line for line in (*image_table(benchmark()), *confidence_table(benchmark())))
    rows = slow_table(benchmark())[2:]
    assert cells(rows[0])[:3] == ["cup", "net (1 photo)", "25.00"]  # not photo b
    assert cells(rows[1])[:4] == ["cup", "slow (1 photo)", "24.00", "–"]
    assert not any("±" in row for row in rows)


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


def test_each_row_tells_its_commit_where_these_differ():
    assert not any("commit" in table(benchmark())[0] for table in (image_table, light_table, object_table))
    results = benchmark(record("pot", Kind.ORACLE, commit="def"))
    assert [cells(line)[-1] for line in light_table(results)[2:]] == ["abc"] * 6 + ["def"] * 2
    assert cells(light_table(results)[0])[-1] == "commit"
    assert "- commit: abc and def" in results_page(results)
    assert {cells(line)[1] for line in record_table(results)[2:]} == {"abc", "def"}


def test_the_page_names_what_is_missing_and_survives_having_nothing():
    page = results_page(with_lessons())
    assert "**Missing:** bottle, no numbers." in page
    lines = page.splitlines()
    for previous, line in itertools.pairwise(lines):
        if line.startswith("| ---"):
            assert previous.count("|") == line.count("|")
    assert "## Images" not in results_page(BenchResults())
    assert "**not yet scored**" in results_page(BenchResults())


def judged(
    scene: str, disagreement: float, found: float, error: float, kind: Kind = Kind.RUN, **about
) -> Record:
    """Return a record of an object with a verdict, of which relighting found `found` dB."""
    scored = metrics()
    scored["mean"]["relight_psnr_scaled"] = found
    scored["methods"]["net"].update(spheres(error))
    verdict = ObjectVerdict(disagreement, photos=5, surprise=0.25).to_json()
    accuracy = LightAccuracy("net", 16, 0.5, (error / 2, error, error * 3), 1.0, 1.0).to_json()
    return record(scene, kind, scored, object_verdict=verdict, light_accuracy=accuracy, **about)


def test_what_was_said_stands_beside_what_was_found():
    runs = [judged("cup", 0.1, 18.5, 0.2), judged("bowl", 0.05, 23.0, 0.1, Kind.SEED, seed=2)]
    results = BenchResults([*runs, record("pot"), judged("cup", 0.2, 24.5, 0.05, Kind.ORACLE)])
    lines = verdict_table(results)
    assert lines[2:] == [
        "| cup | 0 | poor | 10.0 | .2 | 17.0 | 18.5 | 24.5 | .80 | .300 | .200 | .050 |",
        "| bowl | 2 | good | 5.0 | .2 | 23.0 | 23.0 | – | .80 | .150 | .100 | – |",
    ]  # of two objects no order is told
    assert verdict_table(BenchResults([record("pot")])) == []
    fitted = judged("cup", 0.1, 18.5, 0.2)
    fitted.object_verdict["held_out"] = False
    assert verdict_table(BenchResults([fitted])) == []


def test_an_order_is_told_of_some_objects():
    errors = (0.2, 0.1, 0.05, 0.025)  # disagreements, for 11, 17, 23 and 29 dB
    found = [13.0, 12.0, 23.0, 29.0]
    every = [judged(name, e, f, e) for name, e, f in zip("abcd", errors, found, strict=True)]
    page = results_page(BenchResults(every))
    assert "over 4 objects: .80; mean miss 1.8 dB, worst 5.0 dB." in page
    assert "Of the spheres' mean error over 4: 1.00; mean miss .047, worst .100." in page


def section(page: str, title: str) -> str:
    return page.split(f"## {title}")[1].split("\n## ")[0]


def test_every_table_and_figure_of_the_paper_is_there_without_any_run():
    page = paper_page(BenchResults())
    assert [f"## Table {i}" in page for i in range(1, 6)] == [True] * 5
    assert [f"| {i} |" in section(page, "Figures") for i in range(1, 5)] == [True] * 4
    assert "| the paper's | 24.00 / .87 | 24.01 / .89 | 23.98 / .85 |" in section(page, "Table 3")
    assert "| ours, default | – | not run | not run |" in section(page, "Table 3")
    assert "not run*: Car, Chair, Globe" in section(page, "Table 1")
    assert page.count("python -m benchmarks run --data DATA") >= 5
    for previous, line in itertools.pairwise(page.splitlines()):
        if line.startswith("| ---"):
            assert previous.count("|") == line.count("|")


def test_our_values_stand_under_the_paper_s_and_shorter_runs_say_how_long():
    paper = record(
        "cape", Kind.PAPER, preset="paper", iterations="15 of 40 000 + 20 of 30 000", machine="M", threads="1"
    )
    losses = [record("chair", Kind.LOSS, label="L2, both weights", seed=seed) for seed in (0, 1)]
    page = paper_page(BenchResults([record("cape"), record("chair"), paper, *losses]))
    assert "| ours, default | – | not run | 30.00 / .900 |" in section(page, "Table 3")
    assert "cape: probe-mlp, paper's settings, 15 of 40 000 + 20 of 30 000 iterations." in section(
        page, "Table 3"
    )
    assert "| ours, default | – | not run | not run | not run |" in section(
        page, "Table 1"
    )  # chair is another one
    assert "| ours, net | .90 | – | cape;" in section(page, "Table 4")
    assert "| L2, both weights | 29.61 / .95 | 27.00 / .8000 | 2 |" in section(page, "Table 5")


def test_an_average_needs_every_scene_of_its_table():
    scenes = ("nerd-gnome", "nerd-motherchild")
    page = paper_page(BenchResults([record(name, scored=metrics()) for name in scenes]))
    assert "| ours, default | 30.00 / .900 | 30.00 / .900 | 30.00 / .900 |" in section(page, "Table 2")
