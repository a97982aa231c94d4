"""What the templates share: the best values of a table, names of scores, and pages in a browser."""

import pytest

from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT, Heading
from lightprobe.report.html import best_cells, table
from lightprobe.report.report import write_report
from tests.report.pages import evaluation, needs_chromium, report_with, run_in_browser

HEADINGS = {
    "up": Heading("up", 1, "", True),
    "down": Heading("down", 1, "", False),
    "none": Heading("none", 1, ""),
}
SCORES = {"a": 20.0, "b": 30.0, "c": 10.0}


def test_the_best_is_the_highest_or_the_lowest_and_alike_values_share_it():
    rows = {
        "a": {"up": 1.0, "down": 2.0, "none": 1.0},
        "b": {"up": 3.01, "down": 5.0, "none": 2.0},
        "c": {"up": 2.99, "down": 4.0},
    }
    assert best_cells(rows, HEADINGS) == {("b", "up"), ("c", "up"), ("a", "down")}
    assert best_cells({"a": rows["a"]}, HEADINGS) == set()


def test_only_compared_rows_have_a_best_one():
    rows = {"a": {"up": 1.0}, "b": {"up": 2.0}, "c": {"up": 3.0}}
    found = table("", rows, HEADINGS, compared=["a", "b"])
    assert [name for name, (cell,) in found.rows.items() if cell.best] == ["b"]
    assert not any(cell.best for (cell,) in table("", rows, HEADINGS).rows.values())


def test_no_name_stands_for_two_scores():
    headings = [*IMAGES.values(), *LIGHTS.values(), *MAPS.values(), *OBJECT.values()]
    assert len({heading.name for heading in headings}) == len(headings)
    for key, heading in (LIGHTS | OBJECT).items():
        scaled = key.endswith("_scaled")
        if scaled or f"{key}_scaled" in LIGHTS | OBJECT:
            assert heading.name.endswith("scaled" if scaled else "raw")


@pytest.mark.slow
@needs_chromium
def test_a_click_on_a_heading_sorts_the_better_values_first(tmp_path):
    write_report(tmp_path / "index.html", report_with(evaluation(SCORES)))
    orders = run_in_browser(
        tmp_path / "index.html",
        """(() => {
          const table = [...document.querySelectorAll('table')].at(-1);
          const names = () => [...table.tBodies[0].rows].map((row) => row.cells[0].textContent);
          const click = (i) => { table.tHead.rows[0].cells[i].querySelector("button").click(); return names(); };
          return [names(), click(1), table.tHead.rows[0].cells[1].ariaSort, click(1), click(0)];
        })()""",
    )
    assert orders == [["a", "b", "c"], ["b", "a", "c"], "descending", ["c", "a", "b"], ["a", "b", "c"]]


@pytest.mark.slow
@needs_chromium
def test_photos_are_put_in_order_and_back(tmp_path):
    write_report(tmp_path / "index.html", report_with(evaluation(SCORES)))
    orders = run_in_browser(
        tmp_path / "index.html",
        """(() => {
          const list = document.querySelector(".order select");
          const choose = (i) => {
            list.selectedIndex = i;
            list.dispatchEvent(new Event("change"));
            return [...document.querySelectorAll("#photos section header b")].map((name) => name.textContent).join("");
          };
          return [list.closest(".order").hidden, list.options[1].textContent, choose(1), choose(2), choose(0)];
        })()""",
    )
    assert orders == [False, "worst PSNR object first", "cab", "bac", "abc"]
