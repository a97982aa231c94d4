"""Completion in the shells themselves, which start no Python, and the list of options against the parser's."""

import re
import shutil
import subprocess

import pytest
import tyro

from lightprobe.cli.completion import command_options
from lightprobe.cli.main import COMMANDS, command_function, main


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    """The script of each shell, written by the command."""
    folder = tmp_path_factory.mktemp("completion")
    return {shell: folder / shell for shell in ("bash", "zsh", "fish")}


def script(scripts, shell, capsys):
    if not scripts[shell].exists():
        assert main(["completion", shell]) == 0
        scripts[shell].write_text(capsys.readouterr().out)
    return scripts[shell]


def run(shell: str, program: str) -> list[str]:
    if shutil.which(shell) is None:
        pytest.skip(f"needs the shell {shell}")
    done = subprocess.run(
        [shell, "-c", program], capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"}
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.split("\n")[:-1]


@pytest.mark.parametrize("name", COMMANDS)
def test_options_are_those_of_the_parser(name, capsys):
    command, _ = command_function(name)
    with pytest.raises(SystemExit):
        tyro.cli(command, args=["--help"], config=(tyro.conf.EnumChoicesFromValues,))
    helped = re.sub(r"[│┃╭╮╰╯─]", " ", capsys.readouterr().out)
    known = {written for each in command_options(name) for written in each.names} - {"--json", "--max-memory"}
    defined = set(re.findall(r"(?:^|[,|]) *(--?[a-z][\w.-]*)", helped, re.M))
    assert known == {option for option in defined if option.rstrip("-") == option}


def test_a_limit_is_offered_where_it_is_taken():
    offered = {
        name: [each.names for each in command_options(name)] for name in ("train", "serve", "fleet predict")
    }
    assert [("--max-memory",) in names for names in offered.values()] == [True, False, False]


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        (["pre"], ["prepare", "predict"]),
        (["train", "--pre"], ["--preset", "--predict.method"]),
        (["train", "--preset", ""], ["quick", "standard", "paper"]),
        (["predict", "run", "--method", "probe-net+"], ["probe-net+solve", "probe-net+optimize"]),
        (["predict", "--no-"], ["--no-background"]),
        (["completion", "z"], ["zsh"]),
        (["fl"], ["fleet"]),
        (["fleet", "p"], ["predict"]),
        (["fleet", "predict", "--retry"], ["--retry-failed"]),
        (["fleet", "train", "--preset", ""], ["quick", "standard", "paper"]),
        (["predict", "--device", ""], ["auto", "cpu", "cuda"]),
        (["predict", "photo"], []),  # left to file names
    ],
)
def test_bash_completes(scripts, capsys, typed, completed):
    words = " ".join(f"'{word}'" for word in ["lightprobe", *typed])
    program = f"source {script(scripts, 'bash', capsys)}; COMP_WORDS=({words}); COMP_CWORD={len(typed)}; _lightprobe;"
    found = run("bash", f'{program} printf "%s\\n" "${{COMPREPLY[@]}}"')
    assert set(completed) <= set(found)
    assert all(word.startswith(typed[-1]) for word in found if word)
    assert completed or found == [""]


def test_fish_completes(scripts, capsys):
    source = f"source {script(scripts, 'fish', capsys)};"
    assert run("fish", f'{source} complete -C "lightprobe pred"')[0].startswith("predict\tone photo in")
    values = run("fish", f'{source} complete -C "lightprobe train --preset "')
    assert [value.split("\t")[0] for value in values] == ["paper", "quick", "standard"]
    words = run("fish", f'{source} complete -C "lightprobe fleet "')
    assert [word.split("\t")[0] for word in words] == ["predict", "train"]
    assert run("fish", f'{source} complete -C "lightprobe fleet predict --retry"')[0].startswith(
        "--retry-failed"
    )
    assert run("fish", f'{source} complete -C "lightprobe predict --retry"') == []
    assert run("fish", f'{source} complete -C "lightprobe predict --save-c"')[0].startswith(
        "--save-camera\tName of"
    )


def test_zsh_reads_the_script(scripts, capsys):
    path = script(scripts, "zsh", capsys)
    assert path.read_text().startswith("#compdef lightprobe\n")
    run(
        "zsh",
        f"autoload -Uz compinit; compinit -u -D; source {path}; [[ $_comps[lightprobe] == _lightprobe ]]",
    )
    program = f"""
    compadd() {{ print -l -- "$@" }}; compdef() {{ }}; _files() {{ print files }}
    _describe() {{ local name=${{@[-1]}}; print -l -- ${{(P)name}} }}
    source {path}
    words=(lightprobe train --preset ''); CURRENT=4; PREFIX=''; _lightprobe
    words=(lightprobe predict --ca); CURRENT=3; PREFIX=--ca; _lightprobe
    words=(lightprobe fleet ''); CURRENT=3; PREFIX=''; _lightprobe
    words=(lightprobe fleet predict --retry); CURRENT=4; PREFIX=--retry; _lightprobe
    words=(lightprobe predict x); CURRENT=3; PREFIX=x; _lightprobe
    """
    said = run("zsh", program)
    assert said[:4] == ["--", "quick", "standard", "paper"]
    assert any(line.startswith("--camera:Camera of the photo") for line in said)
    assert said[said.index("train") - 1 : said.index("train") + 1] == ["--", "train"]
    assert any(line.startswith("--retry-failed:") for line in said)
    assert said[-1] == "files"
