"""completion: what bash, zsh and fish need to complete commands, options and their values.

The script holds all names, so completing starts no Python. It is made from the commands' own signatures: an
option that is added there is completed after the script is written again.
"""

import dataclasses
import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from tyro.conf import FlagCreatePairsOff, Positional

from lightprobe.cli.answer import OPTION, say
from lightprobe.cli.limiting import ELSEWHERE
from lightprobe.cli.limiting import OPTION as LIMIT
from lightprobe.cli.main import COMMANDS, GROUPS, command_function
from lightprobe.cli.options import option


class Shell(StrEnum):
    """A shell that completes."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


@dataclass(frozen=True)
class Option:
    """One option of a command."""

    names: tuple[str, ...]  # as typed, "--output" and "-o"
    help: str = ""
    choices: tuple[str, ...] = ()
    takes_value: bool = True


_POSITIONAL, _NO_PAIR = (get_args(mark)[1] for mark in (Positional[bool], FlagCreatePairsOff[bool]))
_COMMON = (
    Option(("--help", "-h"), "Explain the command.", takes_value=False),
    Option((OPTION,), "Answer with one JSON object.", takes_value=False),
)
_LIMIT = Option((LIMIT,), "Take no more memory than this, such as 4GB.")

_ShellArg = Annotated[
    Positional[Shell], option(metavar="bash|zsh|fish", help="The shell that the script is for.")
]


def completion(shell: _ShellArg) -> None:
    """Print a script that completes commands, options and their values; write it where the shell looks for
    such.

    Examples:
      lightprobe completion bash > ~/.local/share/bash-completion/completions/lightprobe
      lightprobe completion zsh > ~/.zfunc/_lightprobe     # with fpath+=~/.zfunc before compinit in ~/.zshrc
      lightprobe completion fish > ~/.config/fish/completions/lightprobe.fish
    """
    commands = {name: command_options(name) for name in COMMANDS}
    script = {Shell.BASH: _bash, Shell.ZSH: _zsh, Shell.FISH: _fish}[shell](commands)
    say(script.rstrip(), shell=shell, script=script)


def command_options(command: str) -> list[Option]:
    """Return the options of a command under the names that tyro gives them."""
    function = command_function(command)[0]
    function = getattr(function, "func", function)  # of one whose defaults a preset has changed
    hints = get_type_hints(function, include_extras=True)
    found = [_options(name.replace("_", "-"), hints[name]) for name in inspect.signature(function).parameters]
    return [*(each for some in found for each in some), *_COMMON, *([] if command in ELSEWHERE else [_LIMIT])]


def _options(name: str, hint: Any, prefix: str = "") -> Iterator[Option]:
    """Yield the options of a parameter, of a dataclass those of its fields."""
    kind, marks = _unwrapped(hint)
    settings = next((mark for mark in marks if hasattr(mark, "metavar")), None)
    if _POSITIONAL in marks:
        return
    if dataclasses.is_dataclass(kind):
        inner = f"{prefix}{name}." if settings is None or settings.name != "" else prefix
        for field_name, field_hint in get_type_hints(kind, include_extras=True).items():
            yield from _options(field_name.replace("_", "-"), field_hint, inner)
        return
    aliases, words = ((), "") if settings is None else (settings.aliases or (), settings.help or "")
    names = [f"--{prefix}{name}"]
    if kind is bool and _NO_PAIR not in marks:
        names.append(f"--{prefix}no-{name}")
    shown = getattr(settings, "metavar", None) or ""
    named = tuple(shown.split("|")) if "|" in shown and shown.islower() else ()  # of text, "auto|cpu|cuda"
    choices = next((_values(part) for part in (kind, *get_args(kind)) if _values(part)), named)
    yield Option((*names, *aliases), words, choices, takes_value=kind is not bool)


def _unwrapped(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the type of an annotation, and all that is said of it."""
    return (get_args(hint)[0], hint.__metadata__) if get_origin(hint) is Annotated else (hint, ())


def _values(kind: Any) -> tuple[str, ...]:
    return (
        tuple(str(each.value) for each in kind) if isinstance(kind, type) and issubclass(kind, Enum) else ()
    )


def _names(options: list[Option]) -> list[str]:
    return [name for each in options for name in each.names]


def _first_words(commands: dict[str, list[Option]]) -> list[str]:
    """Return what can be typed first: commands of one word, and the first words of those of two."""
    return [*(name for name in commands if " " not in name), *GROUPS]


def _second_words() -> dict[str, str]:
    """Return what may follow a first word that is not an option or a file."""
    return {"completion": " ".join(Shell), **{group: " ".join(words) for group, (_, words) in GROUPS.items()}}


def _with_choices(options: list[Option]) -> list[Option]:
    return [each for each in options if each.choices]


def _bash(commands: dict[str, list[Option]]) -> str:
    listed, values = [], []
    for name, options in commands.items():
        listed.append(f'    "{name}") options="{" ".join(_names(options))}" ;;')
        for each in _with_choices(options):
            places = "|".join(f'"{name}/{written}"' for written in each.names)
            values.append(f'    {places}) values="{" ".join(each.choices)}" ;;')
    second = [
        f'  [[ ${{COMP_WORDS[1]}} == {word} ]] && ((COMP_CWORD == 2)) && values="{following}"'
        for word, following in _second_words().items()
    ]
    return "\n".join(
        [
            "# bash completion of lightprobe, made by `lightprobe completion bash`",
            "_lightprobe() {",
            '  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} options="" values=""',
            "  local command=${COMP_WORDS[1]}",
            f'  [[ " {" ".join(GROUPS)} " == *" $command "* ]] && command="$command ${{COMP_WORDS[2]}}"',
            f'  ((COMP_CWORD == 1)) && values="{" ".join(_first_words(commands))} --help --version"',
            *second,
            "  case $command in",
            *listed,
            "  esac",
            "  case $command/$before in",
            *values,
            "  esac",
            "  [[ -z $values && $word == -* ]] && values=$options",
            "  COMPREPLY=()  # none: file names",
            '  [[ -n $values ]] && COMPREPLY=($(compgen -W "$values" -- "$word"))',
            "}",
            "complete -o default -o bashdefault -F _lightprobe lightprobe",
            "",
        ]
    )


def _zsh(commands: dict[str, list[Option]]) -> str:
    described = " ".join(_zsh_item(name, _summary(name)) for name in _first_words(commands))
    listed, values = [], []
    for name, options in commands.items():
        items = " ".join(_zsh_item(written, each.help) for each in options for written in each.names)
        listed.append(f'    "{name}") options=({items}) ;;')
        for each in _with_choices(options):
            places = "|".join(f'"{name}/{written}"' for written in each.names)
            values.append(f"    {places}) compadd -- {' '.join(each.choices)}; return ;;")
    second = [
        f"  if (( CURRENT == 3 )) && [[ $words[2] == {word} ]]; then compadd -- {following}; return; fi"
        for word, following in _second_words().items()
    ]
    return "\n".join(
        [
            "#compdef lightprobe",
            "# zsh completion of lightprobe, made by `lightprobe completion zsh`",
            "_lightprobe() {",
            "  local -a commands options",
            f"  commands=({described})",
            "  if (( CURRENT == 2 )); then _describe command commands; return; fi",
            *second,
            "  local command=$words[2]",
            f'  [[ " {" ".join(GROUPS)} " == *" $command "* ]] && command="$command $words[3]"',
            "  case $command in",
            *listed,
            "  esac",
            "  case $command/$words[CURRENT-1] in",
            *values,
            "  esac",
            "  if [[ $PREFIX == -* ]]; then _describe -o option options; else _files; fi",
            "}",
            'if [[ $funcstack[1] == _lightprobe ]]; then _lightprobe "$@"; else compdef _lightprobe lightprobe; fi',
            "",
        ]
    )


def _summary(name: str) -> str:
    return GROUPS[name][0] if name in GROUPS else COMMANDS[name][1]


def _zsh_item(name: str, words: str) -> str:
    text = words.replace("'", "’").replace(":", "\\:")
    return f"'{name}:{text}'" if text else f"'{name}'"


def _fish(commands: dict[str, list[Option]]) -> str:
    lines = ["# fish completion of lightprobe, made by `lightprobe completion fish`"]
    for name in _first_words(commands):
        lines.append(
            f"complete -c lightprobe -f -n __fish_use_subcommand -a {name} -d '{_fish_text(_summary(name))}'"
        )
    for word, following in _second_words().items():
        after = f"{_fish_seen(word)}; and not __fish_seen_subcommand_from {following}"
        lines.append(f"complete -c lightprobe -f -n '{after}' -a '{following}'")
    for name, options in commands.items():
        for each in options:
            written = " ".join(f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in each.names)
            value = (
                f" -x -a '{' '.join(each.choices)}'" if each.choices else " -r" if each.takes_value else ""
            )
            words = f" -d '{_fish_text(each.help)}'" if each.help else ""
            lines.append(f"complete -c lightprobe -n '{_fish_seen(name)}' {written}{value}{words}")
    return "\n".join([*lines, ""])


def _fish_seen(name: str) -> str:
    """Return the condition that a command has been typed; a second word alone is no command of that name."""
    first, _, second = name.partition(" ")
    if second:
        return f"__fish_seen_subcommand_from {first}; and __fish_seen_subcommand_from {second}"
    others = [group for group, (_, words) in GROUPS.items() if first in words]
    return f"__fish_seen_subcommand_from {first}" + "".join(
        f"; and not __fish_seen_subcommand_from {group}" for group in others
    )


def _fish_text(words: str) -> str:
    return words.replace("\\", "\\\\").replace("'", "\\'")
