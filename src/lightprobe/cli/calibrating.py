"""calibrate: absolute brightness, by something known in one photo."""

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff

from lightprobe.cli.answer import say
from lightprobe.cli.options import Device, FoundCameraArg, MaskArg, RunArg, numbers, option
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import shell_word
from lightprobe.models.calibration import Calibration
from lightprobe.runs.calibration import (
    Point,
    calibrate_by_albedo,
    calibrate_by_light,
    calibrate_by_meter,
    reset_calibration,
)

_PhotoArg = Annotated[Path | None, option(metavar="IMAGE", help="A photo of the object.")]
_LightArg = Annotated[
    Path | None, option(metavar="ENV.exr", help="The photo's true light, in the photo's exposure.")
]
_AlbedoArg = Annotated[
    str | None, option(metavar="A", help="True albedo of what --at shows, linear: .18, or r,g,b.")
]
_AtArg = Annotated[str | None, option(metavar="X,Y", help="Pixel of the photo, on the object or on a card.")]
_UpArg = Annotated[FlagCreatePairsOff[bool], option(help="The card lies flat; else it faces the camera.")]
_LuxArg = Annotated[
    float | None, option(metavar="LUX", help="Light meter's reading beside the object, its sensor facing up.")
]
_ResetArg = Annotated[FlagCreatePairsOff[bool], option(help="Forget the calibration.")]


def calibrate(
    run: RunArg,
    *,
    photo: _PhotoArg = None,
    camera: FoundCameraArg = None,
    mask: MaskArg = None,
    env: _LightArg = None,
    albedo: _AlbedoArg = None,
    at: _AtArg = None,
    up: _UpArg = False,
    lux: _LuxArg = None,
    reset: _ResetArg = False,
    device: Device = "auto",
) -> None:
    """Tell a run how bright its object truly is, which photos alone cannot: by a light, an albedo or a light
    meter.

    The factor between light and albedo is kept in RUN/calibration.json. From then on predict, render,
    relight, export and eval have true brightness; the files that are in the run already stay as they are.

    Examples:
      lightprobe calibrate runs/cup --photo lit.jpg --camera lit.json --env studio.exr
      lightprobe calibrate runs/cup --photo card.jpg --albedo .18 --at 1210,840
      lightprobe calibrate runs/cup --photo desk.jpg --lux 640
      lightprobe calibrate runs/cup --reset
    """
    known = {"--env": env, "--albedo": albedo, "--lux": lux}
    if reset and (up or any(value is not None for value in (photo, camera, mask, at, *known.values()))):
        raise ConfigError("--reset forgets the calibration, and finds no other; leave it or the rest out.")
    if reset:
        removed = reset_calibration(run)
        say("The calibration is removed." if removed else "There was no calibration.", removed=removed)
        return
    if photo is None or sum(value is not None for value in known.values()) != 1:
        raise ConfigError(f"Give --photo and one of {', '.join(known)}, or --reset.")
    if (albedo is None) != (at is None):
        raise ConfigError("--albedo and --at belong together: the albedo is that of the photo's pixel X,Y.")
    if up and albedo is None:
        raise ConfigError("--up is about a card, whose albedo --albedo tells; leave it out.")
    if env is not None:
        found = calibrate_by_light(run, photo, env, camera=camera, mask=mask, device=device)
    elif lux is not None:
        found = calibrate_by_meter(run, photo, lux, camera=camera, mask=mask, device=device)
    else:
        found = calibrate_by_albedo(
            run, photo, _point(str(albedo), str(at)), camera=camera, mask=mask, up=up, device=device
        )
    _tell(run, found)


def _point(albedo: str, at: str) -> Point:
    """Return the point of --albedo and --at; raise `ConfigError` for what is none."""
    wanted = "one number above 0 and at most 1, or three with commas"
    colors = numbers(albedo, "--albedo", wanted, (1, 3))
    if not all(0 < value <= 1 for value in colors):
        raise ConfigError(f"--albedo must be {wanted}, not '{albedo[:60]}'.")
    r, g, b = colors * 3 if len(colors) == 1 else colors
    place = "two numbers with a comma, pixels from the left and from the top"
    x, y = numbers(at, "--at", place, (2,))
    return Point(x, y, (r, g, b))


def _tell(run: Path, found: Calibration) -> None:
    r, g, b = found.factor
    say(
        f"Light of this run is now {r:.3f}, {g:.3f}, {b:.3f} times its own (red, green, blue), by {found.source}.",
        factor=found.factor,
        source=found.source,
    )
    say(f"Kept in {run / 'calibration.json'}; forget it with: lightprobe calibrate {shell_word(run)} --reset")
