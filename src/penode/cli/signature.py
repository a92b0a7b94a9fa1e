"""What the command line adds to a fit: which command made it, and how long that took."""

import sys
import time
from dataclasses import replace
from pathlib import Path

from penode.fit.fit import Fit


def signed(fit: Fit, began: float) -> Fit:
    """Add the command and its wall time to the provenance."""
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
    facts = {"command": command, "wall_time_s": round(time.monotonic() - began, 2)}
    return replace(fit, provenance={**fit.provenance, **facts})
