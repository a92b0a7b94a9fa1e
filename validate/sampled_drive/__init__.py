"""A synchronous drive of another class than the bench and the simulators, and its logs.

Shares nothing with penode, neither estimator nor bench: a C file compiled at first use, NumPy.
"""
