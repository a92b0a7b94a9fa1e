"""Recordings of drives that other people's simulators simulate, identified by penode.

Two Pythons take part. `plan`, `kinds`, `machines` and `references` run in both and know neither
penode nor a simulator. `record` and the modules that it imports run where the simulators are
installed, `table` where penode is.
"""
