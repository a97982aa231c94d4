"""Two runs beside each other: which photos, by how much they differ, and whether that is clear."""

import re

import pytest

from lightprobe.core.errors import InputError
from lightprobe.report.comparison import Comparison, comparison_page
from tests.report.pages import evaluation, report_with

FIRST = {"a": 20.0, "b": 30.0, "c": 25.0, "only here": 99.0}


def compared(second: dict[str, float], **more) -> Comparison:
    return Comparison(
        ("old", "<new>"), (report_with(evaluation(FIRST)), report_with(evaluation(second, **more)))
    )


def test_differences_are_of_the_photos_that_both_have():
    found = compared({"a": 21.0, "b": 32.0, "c": 28.0, "only there": 0.0})
    assert found.photos == ["a", "b", "c"]
    difference = found.differences()["psnr_masked"]
    assert (difference.first, difference.second, difference.photos) == (25.0, 27.0, 3)
    assert difference.difference == 2.0
    assert difference.interval == pytest.approx(
        4.303 * 1 / 3**0.5, rel=1e-3
    )  # paired: t of two degrees of freedom
    assert found.to_json()["methods"][0]["scores"]["psnr_masked"]["difference"] == 2.0


def test_clear_differences_have_a_colour_and_others_none():
    better, worse = compared({"a": 22.0, "b": 32.1, "c": 27.0}), compared({"a": 18.0, "b": 28.1, "c": 23.0})
    unclear = compared({"a": 10.0, "b": 45.0, "c": 25.0})
    for found, kind in ((better, "better"), (worse, "worse"), (unclear, None)):
        assert re.findall(r'<td class="(better|worse)"', comparison_page(found)) == ([kind] if kind else [])


def test_default_methods_are_compared_though_they_differ():
    found = compared({"a": 21.0, "b": 31.0, "c": 26.0}, method="constant")
    assert found.methods() == [("solve", "constant")]
    assert found.differences()["psnr_masked"].difference == 1.0
    assert "<h3>solve against constant</h3>" in comparison_page(found)


def test_the_page_shows_both_runs_pictures_beside_the_truth():
    page = comparison_page(compared({"a": 21.0, "b": 31.0, "c": 26.0}))
    assert page.count("<section") == 3
    assert page.count("<figcaption>render: old</figcaption>") == 3
    assert page.count("<figcaption>render: &lt;new&gt;</figcaption>") == 3
    assert page.count('alt="photo"') == page.count('alt="true light"') == 3
    assert "<new>" not in page
    assert "http" not in page


def test_photos_without_a_section_lead_nowhere():
    scores = {f"photo {number}": 20.0 + number for number in range(40)}
    reports = tuple(report_with(evaluation(scores)) for _ in range(2))
    page = comparison_page(Comparison(("old", "new"), reports))
    assert page.count("<section") == 32
    assert set(re.findall(r'href="#(photo[^"]*)"', page)) == set(re.findall(r'<section id="([^"]*)"', page))


def test_runs_without_a_common_photo_are_refused():
    with pytest.raises(InputError, match="no test photo in common"):
        compared({"elsewhere": 1.0})
