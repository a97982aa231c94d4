from lightprobe.report.bench_scenes import BENCH_SCENES, Role, ordered, role


def test_what_was_looked_at_while_settings_were_chosen_is_declared():
    assert {name for name in BENCH_SCENES if role(name) is Role.UNTOUCHED} == {"kettle", "figure"}
    looked_at = ("spot", "chair", "bottle", "robot", "vase", "cape", "liberty", "demo")
    assert {role(name) for name in looked_at} == {Role.DEVELOPMENT}
    assert role("cup") is Role.YOURS


def test_scenes_that_nothing_was_chosen_with_come_first():
    assert ordered(["spot", "zebra", "figure", "cup", "chair", "kettle", "cup"]) == [
        "kettle",
        "figure",
        "cup",
        "zebra",
        "chair",
        "spot",
    ]
