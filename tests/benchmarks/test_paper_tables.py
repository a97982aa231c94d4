import itertools

from benchmarks.paper_tables import paper_page
from benchmarks.record import Kind
from benchmarks.results import BenchResults
from tests.benchmarks.records import metrics, record


def section(page: str, title: str) -> str:
    return page.split(f"## {title}")[1].split("\n## ")[0]


def test_every_table_and_figure_of_the_paper_is_there_without_any_run():
    page = paper_page(BenchResults())
    assert [f"## Table {i}" in page for i in range(1, 6)] == [True] * 5
    assert [f"| {i} |" in section(page, "Figures") for i in range(1, 5)] == [True] * 4
    assert "| the paper's | 24.00 / .87 | 24.01 / .89 | 23.98 / .85 |" in section(page, "Table 3")
    assert "| ours, default | – | not run | not run |" in section(page, "Table 3")
    assert "not run*: Car, Chair, Globe" in section(page, "Table 1")
    assert page.count("lightprobe bench --data DATA") >= 5
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
