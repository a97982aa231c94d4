"""What a command answers: lines for people or, with --json, one object for programs.

A command says each line together with the values that it shows. Which of the two goes to standard output is
decided here, for all commands; warnings, errors and progress go to standard error either way.
"""

import contextlib
import dataclasses
import json
import math
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from enum import Enum
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from lightprobe.core.errors import LightprobeWarning
from lightprobe.core.failures import reporting_errors

OPTION = "--json"

_collected: ContextVar[dict[str, Any] | None] = ContextVar("collected", default=None)


def say(line: str, **values: Any) -> None:
    """Print a line, or keep the values that it shows for the object of --json."""
    kept = _collected.get()
    if kept is None:
        print(line)
    else:
        kept.update(values)


def say_one(of: str, line: str, value: Any) -> None:
    """Print a line about one of several things, or append its value to the list `of` of the object of --json."""
    kept = _collected.get()
    if kept is None:
        print(line)
    else:
        kept.setdefault(of, []).append(value)


def keep(**values: Any) -> None:
    """Keep values for the object of --json that no line shows in full."""
    kept = _collected.get()
    if kept is not None:
        kept.update(values)


def is_for_programs() -> bool:
    """Return whether the answer is an object: what only people read need not be made."""
    return _collected.get() is not None


@contextlib.contextmanager
def answering(*, as_object: bool) -> Iterator[None]:
    """Run a command in this context; with `as_object` its values are printed as one JSON object at the end.

    Whatever else would reach standard output goes to standard error then. An error leaves its sentence as
    "error", and an interruption one as well.
    """
    if not as_object:
        token = _collected.set(None)
        try:
            yield
        finally:
            _collected.reset(token)
        return
    kept: dict[str, Any] = {}
    token = _collected.set(kept)
    try:
        with contextlib.redirect_stdout(sys.stderr), reporting_errors():
            yield
    except Exception as error:
        kept["error"] = str(error)
        raise
    except KeyboardInterrupt:
        kept["error"] = "Interrupted."
        raise
    except SystemExit as ended:
        if ended.code:  # tyro has said on standard error what is wrong
            kept["error"] = "The command line cannot be understood; see standard error, and --help."
        raise
    finally:
        _collected.reset(token)
        if "error" in kept or not isinstance(sys.exception(), SystemExit):  # --help answers with a text
            print(_json(plain_values(kept)))


@contextlib.contextmanager
def own_warnings() -> Iterator[None]:
    """Let only warnings of our own through, one sentence each: those of libraries are about code.

    Filters given to Python itself (`-W`, PYTHONWARNINGS) stand.
    """
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", LightprobeWarning)
        warnings.showwarning = _say_warning
        yield


def _say_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning of ours as one sentence, and any other as Python does."""
    words = warnings.formatwarning(message, category, filename, lineno, line)
    if issubclass(category, LightprobeWarning):
        words = f"lightprobe: warning: {message}\n"
    print(words, end="", file=file or sys.stderr)


def _json(value: Any) -> str:
    """Return a JSON text that standard output can hold, whatever its encoding."""
    encoding = getattr(sys.__stdout__, "encoding", None) or "ascii"
    is_unicode = encoding.lower().replace("-", "") == "utf8"
    return json.dumps(value, ensure_ascii=not is_unicode, indent=1, allow_nan=False)


def plain_values(value: Any) -> Any:
    """Return a value as JSON has it: paths as text, arrays as lists, what is not finite as null."""
    if isinstance(value, Enum):
        return plain_values(value.value)
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.ndarray | np.generic) or hasattr(value, "tolist"):
        return plain_values(value.tolist())
    if isinstance(value, Mapping):
        return {str(plain_values(key)): plain_values(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain_values(each) for each in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain_values(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no form in JSON")
