"""Fit: what identification gives back, and its files."""
