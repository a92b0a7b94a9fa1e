"""Two flux maps beside each other."""
