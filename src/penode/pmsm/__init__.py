"""Permanent-magnet synchronous machines: flux-linkage map and resistance from a drive recording."""

from penode.pmsm.study import Study, identify, write

__all__ = ["Study", "identify", "write"]
