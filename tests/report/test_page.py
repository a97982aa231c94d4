"""Pages in a browser: tables and sections in the order that a person asks for."""

import pytest

from lightprobe.report.report import write_report
from tests.report.pages import evaluation, needs_chromium, report_with, run_in_browser

SCORES = {"a": 20.0, "b": 30.0, "c": 10.0}
ROWS = "[...document.querySelectorAll('table')].at(-1)"


@pytest.mark.slow
@needs_chromium
def test_a_click_on_a_heading_sorts_the_better_values_first(tmp_path):
    write_report(tmp_path / "index.html", report_with(evaluation(SCORES)))
    orders = run_in_browser(
        tmp_path / "index.html",
        f"""(() => {{
          const table = {ROWS}, names = () => [...table.tBodies[0].rows].map((row) => row.cells[0].textContent);
          const click = (i) => {{ table.tHead.rows[0].cells[i].querySelector("button").click(); return names(); }};
          return [names(), click(1), table.tHead.rows[0].cells[1].ariaSort, click(1), click(0)];
        }})()""",
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
