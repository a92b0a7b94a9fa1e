"""Benchmarks: each checks accuracy first and prints a ratio from one run."""
