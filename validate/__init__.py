"""Slow studies over machines drawn at random; each prints the table that docs/validation keeps."""
