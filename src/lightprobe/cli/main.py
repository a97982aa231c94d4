"""The `lightprobe` program: finds the command, reads its arguments, and says in one sentence what went wrong."""

import gc
import importlib
import io
import json
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version

from lightprobe.core.errors import INTERRUPTED, LightprobeError

# command -> (module, what it does); only the module of the command in use is imported
COMMANDS = {
    "demo": ("training", "learn the bundled object and write a report, in minutes"),
    "prepare": ("preparing", "find cameras and masks for a plain folder of photos"),
    "inspect": ("inspection", "show what was found in a folder of photos, and what is wrong with it"),
    "fit": ("training", "Phase I: mesh, materials and one environment per photo"),
    "distill": ("training", "Phase II: the predictor of light"),
    "train": ("training", "both phases"),
    "predict": ("predicting", "one photo in, the environment map around the object out"),
    "locate": ("predicting", "camera and mask of a new photo of the object"),
    "insert": ("inserting", "an object of yours (GLB) put into a photo, in the photo's light"),
    "render": ("using", "the object under an environment, from a camera"),
    "relight": ("using", "a turntable and the test views under a new environment"),
    "eval": ("evaluation", "numbers and a report on the test photos"),
    "calibrate": ("calibrating", "true brightness, by a known light, albedo or meter reading in one photo"),
    "view": ("viewing", "runs in the browser: object, light, training, masks"),
    "serve": ("serving", "predictions over HTTP for other programs"),
    "export": ("using", "mesh.glb, textures and environment maps for other programs"),
    "report": ("pages", "a run's report in the browser; two runs compared; many as a gallery"),
    "fleet train": ("fleet", "a run for every scene of a folder, on many machines"),
    "fleet predict": ("fleet", "maps of all photos that a Parquet file lists, on many machines"),
}
# first word of commands of two words -> what these do together, and their second words
GROUPS = {"fleet": ("Scenes and photos as tasks of a Ray cluster", ("train", "predict"))}
# command -> its function, where Python or a module has another use for the name
_FUNCTIONS = {"fleet train": "fleet_train", "fleet predict": "fleet_predict"}
_RESUMED = (
    "demo",
    "fit",
    "distill",
    "train",
    "fleet train",
    "fleet predict",
)  # go on where they stopped
_WITH_PRESETS = ("training", "fleet")  # modules of commands that train

_USAGE = """\
usage: lightprobe COMMAND ...   (lightprobe COMMAND --help explains one)

Turn one photo of a known object into the HDR environment map around it.

Commands:
{commands}

Every command takes --json: its answer is then one JSON object on standard output. With --tyro-print-completion bash
(or zsh, fish) it prints a script that completes its options.

Examples:
  lightprobe demo
  lightprobe prepare photos/cup -o scenes/cup
  lightprobe inspect photos/cup
  lightprobe train photos/cup -o runs/cup
  lightprobe eval runs/cup
  lightprobe predict runs/cup new.jpg -o light.exr
"""


def program() -> int:
    """Run the command line of this process, which ends with it, and return the exit code.

    Half a second of a short command would go into looking for garbage among what libraries make when they are
    imported, then and once more at the end; none of it ever is.
    """
    gc.disable()  # `_run` goes on with it
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of NumPy: as they wait they take PyTorch's cores
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files need not be of the terminal's characters
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        return main(sys.argv[1:])
    except KeyboardInterrupt:  # while libraries are imported; later `_guarded` tells
        print("lightprobe: interrupted.", file=sys.stderr)
        return INTERRUPTED
    finally:
        gc.freeze()


def main(given: Sequence[str]) -> int:
    """Run a command line and return the exit code."""
    if not given or given[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if given else 2
    if given[0] == "--version":
        print(version("lightprobe"))
        return 0
    name = " ".join(given[: 2 if given[0] in GROUPS else 1])
    if name in COMMANDS:
        return _guarded(name, list(given[len(name.split()) :]))
    if name in (f"{given[0]} {word}" for word in ("-h", "--help", "help")):
        print(usage(given[0]))
        return 0
    sentence = f"There is no command '{name}'; see lightprobe --help."
    if "--json" in given:
        print(json.dumps({"error": sentence}))
    print(f"lightprobe: {sentence[0].lower()}{sentence[1:]}", file=sys.stderr)
    return 2


def usage(group: str = "") -> str:
    """Return the help of the program as a whole, or of the commands that begin with the word `group`."""
    lines = "\n".join(
        f"  {name:<13} {does}" for name, (_, does) in COMMANDS.items() if name.startswith(group)
    )
    if group:
        return f"usage: lightprobe {group} COMMAND ...\n\n{GROUPS[group][0]}:\n{lines}"
    return _USAGE.format(commands=lines)


def _guarded(name: str, arguments: list[str]) -> int:
    from lightprobe.cli.answer import own_warnings
    from lightprobe.core.failures import reporting_errors

    try:
        with reporting_errors(), own_warnings():
            _run(name, arguments)
    except LightprobeError as error:
        print(f"lightprobe: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        goes_on = "; the same command goes on from here" if name in _RESUMED else ""
        print(f"lightprobe: interrupted{goes_on}.", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone, as with `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _run(name: str, arguments: list[str]) -> None:
    if os.environ.get("NO_COLOR"):  # https://no-color.org, which tyro itself does not ask
        os.environ.setdefault("PYTHON_TYRO_ANSI_CODES", "False")
    import tyro

    from lightprobe.cli import answer

    given = [argument for argument in arguments if argument != answer.OPTION]
    config = (tyro.conf.EnumChoicesFromValues,)
    with answer.answering(as_object=given != arguments):
        command, description = command_function(name, given)
        if not gc.isenabled():
            gc.freeze()
            gc.enable()
        tyro.cli(command, prog=f"lightprobe {name}", description=description, args=given, config=config)


def command_function(name: str, arguments: Sequence[str] = ()) -> tuple[Callable[..., None], str]:
    """Return a command's function and description; a preset in `arguments` chooses the defaults of those that
    train.
    """
    module = importlib.import_module(f"lightprobe.cli.{COMMANDS[name][0]}")
    command: Callable[..., None] = getattr(module, _FUNCTIONS.get(name, name))
    description = (command.__doc__ or "").replace("\n    ", "\n").strip()
    if COMMANDS[name][0] in _WITH_PRESETS:
        command = module.with_preset(command, chosen_preset(arguments))
    return command, description


def chosen_preset(arguments: Sequence[str]) -> str:
    """Return the value of `--preset` before the rest is read: the defaults of all other options depend on it.

    Given twice, the last one counts, as of every option.
    """
    chosen = "quick"
    for i, argument in enumerate(arguments):
        if argument == "--preset" and i + 1 < len(arguments):
            chosen = arguments[i + 1]
        elif argument.startswith("--preset="):
            chosen = argument.partition("=")[2]
    return chosen
