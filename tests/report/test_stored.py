"""What a report was made from, read back; a run may come from anywhere."""

import json

import pytest

from lightprobe.core.errors import InputError
from lightprobe.report.report import page_record, read_report, report_page
from tests.report.pages import evaluated_run


def test_the_page_is_made_again_from_what_is_stored(tmp_path):
    run = evaluated_run(tmp_path / "run", {"a": 20.0, "b": 30.0})
    report = read_report(run)
    assert report.facts == {"seed": "0"}
    assert report_page(report, tmp_path).count("<section") == 2


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("pictures", {"a": {"photo": 'x" onerror="alert(1)'}}),
        ("pictures", {"a": {"photo": "data:image/svg+xml;base64,AAAA"}}),
        ("pictures", []),
        ("title", 3),
        ("facts", {"seed": []}),
        ("commands", "ls"),
    ],
)
def test_a_page_s_content_is_checked(tmp_path, key, value):
    run = evaluated_run(tmp_path / "run", {"a": 20.0})
    record = page_record(run.report_file)
    record.write_text(json.dumps({**json.loads(record.read_text()), key: value}))
    with pytest.raises(InputError, match=r"page\.json is damaged.*lightprobe eval"):
        read_report(run)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mean", {"psnr": "<b>"}),
        ("mean", {"psnr": 10**400}),
        ("methods", {"solve": {"psnr": None}}),
        ("photos", {"a": 3}),
        ("photos", {"a": {"methods": {"solve": {"psnr": []}}}}),
        ("default_method", "<script>"),
        ("default_method", []),
        ("interval", {"solve": 1}),
        ("confidence", {"solve": {"bins": 4}}),
    ],
)
def test_scores_are_checked(tmp_path, key, value):
    run = evaluated_run(tmp_path / "run", {"a": 20.0})
    run.metrics_file.write_text(json.dumps({**json.loads(run.metrics_file.read_text()), key: value}))
    with pytest.raises(InputError, match=r"metrics\.json is damaged.*lightprobe eval"):
        read_report(run)


def test_a_run_that_was_not_evaluated_says_so(tmp_path):
    run = evaluated_run(tmp_path / "run", {"a": 20.0})
    page_record(run.report_file).unlink()
    with pytest.raises(
        InputError, match=r"has no page\.json of an evaluation; make it anew with: lightprobe eval"
    ):
        read_report(run)
