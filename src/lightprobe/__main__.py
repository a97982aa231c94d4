"""`python -m lightprobe`: the program, where modules are started instead of commands."""

import sys

from lightprobe.cli.main import program

if __name__ == "__main__":
    sys.exit(program())
