"""Horizon: the ladder of horizons, what the data can tell, and the choice."""
