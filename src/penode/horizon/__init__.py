"""Horizon: the ladder of horizons, what the data determine, and the choice."""
