"""Experiments and benchmarks: each module is a command, ``python -m evaluation.NAME``."""
