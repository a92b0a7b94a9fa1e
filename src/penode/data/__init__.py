"""Recordings: read from files, checked and cut into windows; nothing here repairs data."""
