"""What `eval` prints; `test_commands` runs it on a trained run."""

from lightprobe.cli.evaluation import print_tables
from lightprobe.evaluation import Evaluation
from lightprobe.prediction import Method
from lightprobe.report.headings import LIGHTS, OBJECT

OWN, OTHER = Method.PROBE_NET_OPTIMIZE, Method.CONSTANT


def test_console_and_report_call_a_score_by_one_name(capsys):
    scores = {"psnr": 30.0, "relit_psnr": 21.25, "relit_psnr_scaled": 25.75, "light_log_rmse": 0.5}
    print_tables(Evaluation(OWN, {"a": {OWN: scores, OTHER: scores}}, {"relight_psnr": 21.906, "chamfer": 0.0123}))
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= 80
    table = next(part for part in printed.split("┏") if "25.75" in part)
    cells = [[cell.strip() for cell in line.split(line[0])[1:-1]] for line in table.splitlines() if line[0] in "┃│"]
    rows = [cells.index(row) for row in cells if row[0] == OWN.value]
    names = [" ".join(filter(None, words)) for words in zip(*cells[: rows[0]], strict=True)]
    assert dict(zip(names[1:], cells[rows[0]][1:], strict=True)) == {
        LIGHTS["relit_psnr"].name: "21.25", LIGHTS["relit_psnr_scaled"].name: "25.75",
    }  # fmt: skip
    assert f"{OBJECT['relight_psnr'].name}: 21.91\n" in printed
    assert f"{OBJECT['chamfer'].name}: 0.0123\n" in printed
    assert "relight_psnr" not in printed
