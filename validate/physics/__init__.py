"""Forty drawn physics: an equation for penode, a plant of its own for the simulator, a table row.

Plant and simulator share nothing with penode: they are plain Python and SciPy's LSODA.
"""
