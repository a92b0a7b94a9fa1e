"""The report of a machine's identification."""
