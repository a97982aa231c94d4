"""The program as a person runs it."""

from lightprobe.cli.main import main


def succeed(*arguments) -> None:
    """Run a command, which must end well."""
    assert main([str(argument) for argument in arguments]) == 0


def fails(arguments: list[str], capsys, words: list[str]) -> int:
    """Run a command that must fail; check its message and return the exit code."""
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line]
    assert code != 0
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("lightprobe: ")
    assert "Traceback" not in captured.err + captured.out
    for word in words:
        assert word in lines[0], lines[0]
    return code
