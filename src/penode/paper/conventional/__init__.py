"""Conventional methods, each an estimator that gives the same `Fit` as the rest of penode."""
