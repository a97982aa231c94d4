"""The population of random objects: what it is made of, how its scores are read, and a small scene of either kind."""

import json

import numpy as np
import pytest

from benchmarks import population
from benchmarks.__main__ import main
from benchmarks.shoot import models, objects
from lightprobe.core.config import DecomposeConfig
from lightprobe.evaluation.oracle import can_be_oracle
from lightprobe.scene import load_scene

TINY = population.Sizes(photos=6, test=2, side=64, samples=8, places=2, width=96)


def scores(**changes: float) -> dict:
    """Scores of a perfect object."""
    spheres = {"diffuse": 0.1, "matte": 0.2, "mirror": 0.4}
    found = {name: 0.0 for name in population.COLUMNS if not name.startswith("over_")}
    grey = {name: 4 * value for name, value in spheres.items()}
    return found | {"base_color_ratio": 1.0} | spheres | {"true": spheres, "grey": grey} | changes


def test_objects_differ_in_size_of_their_palette():
    counts = set()
    for seed in range(population.OBJECTS):
        parts = objects.make_object("random", seed)
        assert np.linalg.norm(models.corners(parts), axis=1).max() == pytest.approx(1.0)
        counts.add(len({id(part.paint) for part in parts}))
    assert counts == {1, 2, 3, 4, 5}  # of up to six that are drawn, as some are on no part


def test_a_row_compares_with_the_true_object_and_a_grey_map():
    row = population.summary(scores(diffuse=0.2, matte=0.2, mirror=0.6))
    assert row["over_true"] == pytest.approx((2 + 1 + 1.5) / 3)
    assert row["over_grey"] == pytest.approx((0.5 + 0.25) / 2)


def test_the_worst_three_are_the_worst_whichever_way_a_score_grows():
    rows = {}
    for k in range(8):
        value = {
            "roughness_mae": 0.1 * k,
            "relight_psnr_scaled": 10.0 * k,
            "base_color_ratio": 1.5 ** (k - 3),
        }
        rows[f"studio-{k:02d}"] = population.summary(scores(**value))
    median, worst = (
        [cell.strip() for cell in line.split("|")[2:-1]] for line in population.table(rows).splitlines()[-2:]
    )
    at = list(population.COLUMNS).index
    assert (median[at("roughness_mae")], worst[at("roughness_mae")]) == ("0.350", "0.600")
    assert (median[at("relight_psnr_scaled")], worst[at("relight_psnr_scaled")]) == ("35.0", "10.0")
    farthest = np.mean([1.5**4, 1.5**3, 1.5**-3])
    assert worst[at("base_color_ratio")] == f"{farthest:.2f}"


def test_its_settings_are_quicks_but_for_sizes():
    small, quick = population.scaled(), DecomposeConfig()
    differ = {name for name, value in vars(small).items() if value != getattr(quick, name)}
    assert all(getattr(small, name) < getattr(quick, name) for name in differ)
    assert "metallic_prior" not in differ


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--objects", "36"], "There is no object 36; there are 0 to 35."),
        (["--jobs", "0"], "--jobs 0 is too few; give 1 or more."),
        (["--set", "gloss=1"], "--set gloss=1 names no number of DecomposeConfig."),
    ],
)
def test_a_wrong_wish_is_refused(words, sentence, tmp_path, capsys):
    assert main(["population", str(tmp_path / "scenes"), str(tmp_path / "results"), *words]) == 3
    assert capsys.readouterr().err.strip() == sentence
    assert not (tmp_path / "results").exists()


def test_scores_of_other_settings_are_not_mixed(path_tracer, tmp_path, capsys):
    (tmp_path / "studio-00.json").write_text(json.dumps(scores()))
    words = ["population", str(tmp_path / "scenes"), str(tmp_path), "--objects", "--set"]
    assert main([*words, "metallic_prior=.02"]) == 0
    assert "| studio-00 | 0.000 |" in capsys.readouterr().out
    assert main(words) == 3
    assert "holds scores of other settings" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1])
def test_a_small_scene_has_all_that_is_scored(path_tracer, tmp_path, number):
    folder = tmp_path / population.name_of(number)
    population.make_scene(folder, number, TINY)
    scene = load_scene(folder)
    assert (len(scene.train), len(scene.test), len(scene.relight)) == (6, 2, 8)
    assert can_be_oracle(scene)
    found = json.loads((folder / "truth.json").read_text())
    # two photos of 64 pixels tell little of the light; what full ones tell is in the scores
    assert all(0 < found[whose][name] < 1 for whose in ("true", "grey") for name in ("diffuse", "matte"))
    groups = {photo.light_group for photo in scene.train}
    assert len(groups - {None}) == (0, 2)[number]
    times = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    population.make_scene(folder, number, TINY)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == times
