"""Readers of recordings, one file format each; none knows another."""
