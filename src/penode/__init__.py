"""penode: physical parameters and learned maps from recorded data, at the horizon that fits.

These are the names for every day. `penode.engine` has those for writing one's own training,
`penode.pmsm` those for machines, `penode.bench` those of the simulated drive, and `penode.paper`,
which is imported by itself, those of the paper. Modules below these five may move.
"""

from importlib.metadata import version

from lazy_loader import attach_stub

__version__ = version("penode")
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
