"""The measurements behind benchmarks/SPEED.md; `measure_speed.py` is the command."""
