from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT, Heading
from lightprobe.report.report_tables import best_cells, score_list, table

HEADINGS = {
    "up": Heading("up", 1, "", True),
    "down": Heading("down", 1, "", False),
    "none": Heading("none", 1, ""),
}


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
    text = table("", rows, HEADINGS, compared=["a", "b"])
    assert "<b>2.0</b>" in text
    assert text.count("<b>") == 1
    assert "<b>" not in table("", rows, HEADINGS)


def test_a_list_has_the_scores_that_there_are_with_their_meaning():
    text = score_list({"chamfer": 0.01, "psnr": 3.0}, OBJECT)
    assert text.count("<tr>") == 1
    assert OBJECT["chamfer"].note in text


def test_no_name_stands_for_two_scores():
    headings = [*IMAGES.values(), *LIGHTS.values(), *MAPS.values(), *OBJECT.values()]
    assert len({heading.name for heading in headings}) == len(headings)
    for key, heading in (LIGHTS | OBJECT).items():
        scaled = key.endswith("_scaled")
        if scaled or f"{key}_scaled" in LIGHTS | OBJECT:
            assert heading.name.endswith("scaled" if scaled else "raw")
