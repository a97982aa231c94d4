"""The scenes of the benchmark by name, and whether they were looked at while settings were chosen."""

from collections.abc import Iterable
from enum import StrEnum


class Role(StrEnum):
    """What a scene was used for in the development of the program, as the tables say it."""

    UNTOUCHED = "untouched: no setting was chosen by it"
    YOURS = "yours: not used in development"
    DEVELOPMENT = "development: looked at while settings were chosen"


_ROLES = {
    "kettle": Role.UNTOUCHED,
    "figure": Role.UNTOUCHED,
    "chair": Role.DEVELOPMENT,
    "spot": Role.DEVELOPMENT,
    "bottle": Role.DEVELOPMENT,
    "robot": Role.DEVELOPMENT,
    "vase": Role.DEVELOPMENT,
    "cape": Role.DEVELOPMENT,
    "liberty": Role.DEVELOPMENT,
    "demo": Role.DEVELOPMENT,
}
BENCH_SCENES = tuple(name for name in _ROLES if name != "demo")  # which has a command of its own


def role(scene: str) -> Role:
    """Return what a scene was used for."""
    return _ROLES.get(scene, Role.YOURS)


def ordered(scenes: Iterable[str]) -> list[str]:
    """Return each scene once, those that nothing was chosen with first, then in the order of the list above."""
    roles, known = list(Role), list(_ROLES)
    place = {scene: known.index(scene) if scene in known else len(known) for scene in scenes}
    return sorted(place, key=lambda scene: (roles.index(role(scene)), place[scene], scene))
