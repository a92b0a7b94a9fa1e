"""Kernels in C that XLA calls on a processor, compiled where they run."""
