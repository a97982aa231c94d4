from benchmarks.record import Kind, Record
from benchmarks.results import BenchResults
from benchmarks.tables import results_page, verdict_table
from lightprobe.models import LightAccuracy, ObjectVerdict
from tests.benchmarks.records import metrics, record, spheres


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
