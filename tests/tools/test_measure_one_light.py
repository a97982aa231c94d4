"""Which sets of photos are judged, and the table of how far apart their lights are."""

from types import SimpleNamespace

import pytest

import measure_one_light


def photo(name, light=None):
    return SimpleNamespace(name=name, truth=SimpleNamespace(environment=light))


def scene():
    relight = [
        photo(f"{light}{k}", light) for light in ("sun", "lamp") for k in range(3 if light == "sun" else 2)
    ]
    return SimpleNamespace(relight=relight, test=[photo("t0"), photo("t1")], train=[photo("u0"), photo("u1")])


def test_sets_of_one_light_are_its_first_photos():
    found = [[one.name for one in photos] for photos in measure_one_light.of_one_light(scene(), 3)]
    assert found == [["sun0", "sun1", "sun2"]]  # of the lamp there are two only
    assert len(list(measure_one_light.of_one_light(scene(), 2))) == 2


def test_sets_of_different_lights_are_drawn_alike_for_a_seed():
    first, again, other = (
        [[one.name for one in photos] for photos in measure_one_light.of_different_lights(scene(), 3, seed)]
        for seed in (0, 0, 1)
    )
    assert first == again != other
    assert all(len(set(names)) == 3 and not any("sun" in name for name in names) for names in first)


def test_the_table_counts_warnings(monkeypatch, capsys):
    def together(views, method, refuse):
        apart = 0.9 if any(name.startswith(("t", "u")) for name in views) else 0.1
        verdict = SimpleNamespace(apart=apart, of_different_lights=apart > 0.5)
        return SimpleNamespace(verdict=verdict), None

    monkeypatch.setattr(measure_one_light, "load_scene", lambda path: scene())
    monkeypatch.setattr(measure_one_light, "load_pixels", lambda one: one.name)
    monkeypatch.setattr(
        measure_one_light.Predictor, "load", lambda path: SimpleNamespace(predict_together=together)
    )
    monkeypatch.setattr(
        "sys.argv", ["measure_one_light.py", "--data", "data", "--runs", "runs", "--scenes", "chair"]
    )
    measure_one_light.main()
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| chair")]
    assert rows[0] == "| chair | one | 2 | 2 | 0.10 | 0.10 | 0.10 | 0 |"
    assert rows[1] == "| chair | different | 2 | 10 | 0.90 | 0.90 | 0.90 | 10 |"


def test_one_photo_is_not_judged():
    verdict = SimpleNamespace(apart=None, of_different_lights=False)
    predictor = SimpleNamespace(predict_together=lambda *a, **k: (SimpleNamespace(verdict=verdict), None))
    with pytest.raises(ValueError, match="not apart from itself"):
        measure_one_light.judged(predictor, [])
