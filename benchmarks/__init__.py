"""Measurements of the program, run from a checkout with lightprobe installed: python -m benchmarks NAME --help."""
