"""What masks and cameras are usually wrong by, each with the change that undoes it.

Notation: m is a camera-to-world matrix as `Camera.camera_to_world` has it, (4, 4), with columns right, up, back
and position. A change takes the views of a scene in the order of their files and returns them without the mistake.
"""

import enum
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lightprobe.scene.consistency import View

Views = Sequence[View]
Change = Callable[[Views], list[View]]

_UNITS = (1000.0, 100.0, 39.37, 10.0, 3.281, 2.54, 0.3937, 0.3048, 0.1, 0.0254, 0.01, 0.001)


class Kind(enum.Enum):
    """Causes of which one sentence is enough: those of a kind differ by a number or a turn."""

    INVERTED = "inverted"
    TURNED = "turned"
    MIRRORED = "mirrored"
    AXES = "axes"
    POSITIONS = "positions"
    INTRINSICS = "intrinsics"
    ORDER = "order"
    UNITS = "units"


class Scope(enum.Enum):
    """How many photos of a scene can have a cause."""

    ANY = "any"
    ALL = "all"
    SOME = "some"  # of all photos it would be no mistake


@dataclass(frozen=True)
class Cause:
    """A mistake: what of the photos is how, what to do, and the change that undoes it."""

    kind: Kind
    subject: str  # what is wrong, "masks" of some photos
    state: str  # how, after "look"
    remedy: str
    change: Change
    scope: Scope = Scope.ANY
    turn: int = 0  # degrees clockwise by which the masks must be turned, of a turn


def pose_causes(views: Views) -> list[Cause]:
    """Return the mistakes of orientations, axes, positions and order that the views may have."""
    return [*_turns(), *_axes(), *_positions(), *_units(), *_orders(views)]


def inverted() -> Cause:
    """Return the cause that masks are black where the object is."""
    return Cause(
        Kind.INVERTED,
        "masks",
        "inverted",
        "the object must be white (or opaque) and all else black (or transparent)",
        lambda views: [replace(view, mask=1 - view.mask) for view in views],
    )


_Matrix = Callable[[np.ndarray], np.ndarray]


def _moved(change: _Matrix) -> Change:
    """Return the change of all views by one of their matrices m (4, 4)."""

    def changed(view: View) -> View:
        return replace(view, camera=replace(view.camera, camera_to_world=change(view.camera.camera_to_world)))

    return lambda views: [changed(view) for view in views]


def _columns(right: np.ndarray) -> _Matrix:
    """Return the change m -> m R of the camera's own axes by R (3, 3)."""
    whole = np.eye(4)
    whole[:3, :3] = right
    return lambda m: m @ whole


def _then(first: _Matrix, second: _Matrix) -> _Matrix:
    return lambda m: second(first(m))


_QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
_OPENCV, _PYTORCH3D = _columns(np.diag([1.0, -1, -1])), _columns(np.diag([-1.0, 1, -1]))


def _mirrored(change: Change | None = None) -> Change:
    """Return the change that mirrors the masks left to right, then does `change`."""

    def mirrored(views: Views) -> list[View]:
        flipped = [replace(view, mask=np.ascontiguousarray(view.mask[:, ::-1])) for view in views]
        return change(flipped) if change else flipped

    return mirrored


def _turns() -> Iterator[Cause]:
    """Yield what an EXIF orientation does that was applied to masks, cameras or photos but not to all three.

    A camera that is turned about its view axis stands for a turned mask: it needs no square photos.
    """
    half, quarter, back = _columns(np.diag([-1.0, -1, 1])), _columns(_QUARTER), _columns(_QUARTER.T)
    lines = (
        "m[:3, :2] *= -1",
        "m[:3, :2] = np.stack([m[:3, 1], -m[:3, 0]], 1)",
        "m[:3, :2] = np.stack([-m[:3, 1], m[:3, 0]], 1)",
    )
    turns = zip((180, 270, 90), (half, quarter, back), lines, strict=True)
    for degrees, change, line in turns:
        yield Cause(Kind.TURNED, "cameras", "", line, _moved(change), turn=degrees)
    remedy = (
        "mirror the photos and their masks as the cameras saw them, or mirror the cameras' world "
        "(m[0] *= -1, then m[:3, 0] *= -1)"
    )
    mirrors: tuple[tuple[str, Change | None], ...] = (
        ("", None),
        (" and upside down", _moved(half)),
        (", and turned by 90 degrees clockwise", _moved(back)),
        (", and turned by 90 degrees anticlockwise", _moved(quarter)),
    )
    for words, then in mirrors:
        state = f"mirrored left to right{words} against the cameras"
        yield Cause(Kind.MIRRORED, "photos", state, remedy, _mirrored(then))


def _axes() -> Iterator[Cause]:
    """Yield other conventions of axes, and matrices that map the other way."""
    opencv, pytorch = "m[:3, 1:3] *= -1", "m[:3, [0, 2]] *= -1"
    inverse: _Matrix = np.linalg.inv
    seen = "OpenCV's (y down, looking along +z)", "PyTorch3D's (x left, looking along +z)"
    kept = "negate the second and third column of each camera-to-world matrix m"
    yield Cause(Kind.AXES, "cameras", f"like {seen[0]}", f"{kept} ({opencv})", _moved(_OPENCV))
    kept = "negate the first and third column of each camera-to-world matrix m"
    yield Cause(Kind.AXES, "cameras", f"like {seen[1]}", f"{kept} ({pytorch})", _moved(_PYTORCH3D))
    store = "store their inverses (m = np.linalg.inv(m))"
    yield Cause(Kind.AXES, "matrices of the cameras", "like world-to-camera", store, _moved(inverse))
    for name, axes, line in (("OpenCV", _OPENCV, opencv), ("PyTorch3D", _PYTORCH3D, pytorch)):
        store = f"store their inverses with other axes (m = np.linalg.inv(m), then {line})"
        state = f"like world-to-camera with {name} axes"
        yield Cause(Kind.AXES, "matrices of the cameras", state, store, _moved(_then(inverse, axes)))


def _transposed(m: np.ndarray) -> np.ndarray:
    """Return m (4, 4) with its rotation inverted and its position kept."""
    turned = m.copy()
    turned[:3, :3] = m[:3, :3].T
    return turned


def _from_translation(axes: np.ndarray) -> _Matrix:
    """Return the change of m (4, 4) whose last column is a world-to-camera translation, in `axes` (3,) of signs."""

    def moved(m: np.ndarray) -> np.ndarray:
        found = m.copy()
        found[:3, 3] = -(m[:3, :3] * axes) @ m[:3, 3]
        return found

    return moved


def _positions() -> Iterator[Cause]:
    """Yield rotations and positions that do not belong together."""
    transposed = "m[:3, :3] = m[:3, :3].T"
    for words, axes, line in (
        ("", _columns(np.eye(3)), ""),
        (", with OpenCV axes", _OPENCV, ", then m[:3, 1:3] *= -1"),
        (", with PyTorch3D axes", _PYTORCH3D, ", then m[:3, [0, 2]] *= -1"),
    ):
        remedy = f"transpose the rotation of each matrix m ({transposed}{line})"
        state = f"like world-to-camera{words}, beside positions in the world"
        yield Cause(
            Kind.POSITIONS, "rotations of the cameras", state, remedy, _moved(_then(_transposed, axes))
        )
    for line, signs in (
        ("m[:3, 3] = -m[:3, :3] @ m[:3, 3]", (1, 1, 1)),
        ("m[:3, 3] = -(m[:3, :3] * [1, -1, -1]) @ m[:3, 3]", (1, -1, -1)),
    ):
        state = "like translations of world-to-camera matrices"
        remedy = f"store the cameras' centres ({line})"
        yield Cause(
            Kind.POSITIONS,
            "positions of the cameras",
            state,
            remedy,
            _moved(_from_translation(np.array(signs))),
        )
    worlds = {
        "(x, -y, -z)": np.diag([1.0, -1, -1]),
        "(x, z, -y)": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
        "(x, -z, y)": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        "(-x, -y, -z)": -np.eye(3),
    }
    for written, world in worlds.items():
        state = "given in other axes than their rotations"
        remedy = f"write each position (x, y, z) as {written}"
        yield Cause(
            Kind.POSITIONS, "positions of the cameras", state, remedy, _moved(_positioned(world)), Scope.ALL
        )


def _positioned(world: np.ndarray) -> _Matrix:
    """Return the change of positions alone by `world` (3, 3)."""

    def moved(m: np.ndarray) -> np.ndarray:
        found = m.copy()
        found[:3, 3] = world @ m[:3, 3]
        return found

    return moved


def _units() -> Iterator[Cause]:
    """Yield other units of some photos' positions; all photos may have any."""
    for factor in _UNITS:
        remedy = f"multiply their positions by {factor:.4g}"
        change = _moved(_positioned(factor * np.eye(3)))
        yield Cause(
            Kind.UNITS,
            "positions of the cameras",
            "given in another unit than the others",
            remedy,
            change,
            Scope.SOME,
        )


def _reordered(order: Sequence[int]) -> Change:
    """Return the change that gives photo i the pose of photo order[i]; its focal length is its own."""

    def changed(views: Views) -> list[View]:
        poses = [views[k].camera.camera_to_world for k in order]
        pairs = zip(views, poses, strict=True)
        return [replace(view, camera=replace(view.camera, camera_to_world=pose)) for view, pose in pairs]

    return changed


def taken_from(views: Views, index: int) -> Cause:
    """Return the cause that a photo has its own camera at the photo `index`."""
    name = views[index].name
    remedy = "give each of these photos its own camera"
    return Cause(
        Kind.ORDER,
        "cameras",
        f"exchanged for that of {name}",
        remedy,
        _reordered([index] * len(views)),
        Scope.SOME,
    )


def _orders(views: Views) -> Iterator[Cause]:
    """Yield orders of cameras that are not the photos': photos are taken in the order of their names."""
    count = len(views)
    near, far = ("next", "previous"), ("next but one", "previous but one")
    steps = near, near[::-1], far, far[::-1]
    for step, (whose, source) in zip((-1, 1, -2, 2), steps, strict=True):
        yield Cause(
            Kind.ORDER,
            "cameras",
            f"like those of the {whose} photo",
            f"give each of these photos the camera that the {source} one has in the order of names (a photo more or "
            "fewer than cameras shifts all that follow)",
            _reordered([(i + step) % count for i in range(count)]),
        )
    yield Cause(
        Kind.ORDER,
        "cameras",
        "listed in the reverse order of the photos",
        "reverse the list of cameras",
        _reordered(range(count)[::-1]),
        scope=Scope.ALL,
    )
    natural = sorted(range(count), key=lambda i: _natural(views[i].name))
    if natural == list(range(count)):
        return
    ranks = np.argsort(natural).tolist()
    for order, cameras, photos in ((ranks, "1, 2, 10", "1, 10, 2"), (natural, "1, 10, 2", "1, 2, 10")):
        yield Cause(
            Kind.ORDER,
            "cameras",
            f"listed in another order of names ({cameras}) than the photos ({photos})",
            "list both in one order; names with leading zeros (01, 02, 10) have only one",
            _reordered(order),
            Scope.ALL,
        )


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts names as people count: 2 before 10."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
