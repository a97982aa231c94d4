import measure_plain_photos
from tests.scene.plain_world import take


def test_a_row_of_the_table(tmp_path):
    cells = [cell.strip() for cell in measure_plain_photos.row(take(tmp_path, 3)).split("|")[1:-1]]
    assert len(cells) == measure_plain_photos._HEAD.count("|") - 1
    assert cells[0].startswith("3 of ")
    sharp, one, two, four = (float(cell.split(" / ")[-1]) for cell in cells[1:5])
    assert sharp > one > two > four
    assert float(cells[-1]) > 0.1
