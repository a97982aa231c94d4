"""`python -m lightprobe`: the program, for what starts modules instead of commands, such as `torchrun`."""

import sys

from lightprobe.cli.main import program

if __name__ == "__main__":
    sys.exit(program())
