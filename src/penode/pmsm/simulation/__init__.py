"""The identified machine on the simulated bench, beside a recording."""
