"""Other people's simulators: ``python -m validate.other_simulators [HALF]``.

``... record --python PYTHON --thor FILE`` makes the recordings first, in an environment that has
the simulators and no penode; see docs/validation/other-simulators.md. Then ``penode identify`` runs
on all recordings with nothing beside their files, and the tables of both halves are printed, or
of one, ``developing`` or ``held-out``. The half held out is for judging only: what it shows is
never a reason to change anything. Ctrl-C ends a table early; the same command goes on.
"""

import argparse
import subprocess
import sys

from validate.other_simulators.plan import HALVES
from validate.other_simulators.table import print_table


def main() -> None:
    """Record, or print the tables."""
    if sys.argv[1:2] == ["record"]:
        parser = argparse.ArgumentParser(prog="validate.other_simulators record")
        parser.add_argument("--python", required=True, help="of the simulators' environment")
        asked, rest = parser.parse_known_args(sys.argv[2:])
        module = "validate.other_simulators.record"
        sys.exit(subprocess.run([asked.python, "-m", module, *rest], check=False).returncode)
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    names = {half.replace(" ", "-"): half for half in HALVES}
    parser.add_argument("half", nargs="?", choices=names)
    asked = parser.parse_args()
    print_table((names[asked.half],) if asked.half else HALVES)


if __name__ == "__main__":
    main()
