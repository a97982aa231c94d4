"""Many runs on one page."""

from lightprobe.report.gallery import gallery_page, middling_photo
from tests.report.pages import evaluation, report_with


def test_each_run_has_a_card_that_leads_to_its_report():
    reports = {"cup & co": report_with(evaluation({"a": 20.0})), "pot": report_with(evaluation({"b": 30.0}))}
    page = gallery_page(reports)
    assert page.count("<section") == 2
    assert '<a href="cup%20%26%20co/index.html">cup &amp; co</a>' in page
    assert "PSNR object 30.00" in page
    assert page.count("<img") == 2 * 4  # photo, render, map, spheres


def test_the_picture_is_neither_the_best_nor_the_worst():
    assert middling_photo(report_with(evaluation({"a": 10.0, "b": 30.0, "c": 20.0}))) == "c"
    assert middling_photo(report_with(evaluation({"a": 10.0}), titles=())) == "a"


def test_a_run_without_pictures_still_has_its_scores():
    report = report_with(evaluation({"a": 10.0}))
    page = gallery_page({"pot": type(report)("t", report.metrics)})
    assert "<img" not in page
    assert "PSNR object 10.00" in page
