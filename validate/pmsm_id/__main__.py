"""The whole benchmark: ``python -m validate.pmsm_id``.

Writes the logs that are missing, has every method answer those that it has not answered yet, and
prints the table. ``--motulator`` and ``--peers`` name the Pythons of the environments that hold
motulator, and CasADi and jax-sysid; without them their logs and methods are left out. Names of
methods at the end restrict it to these; a method of one's own that wrote its answers is scored by
its name.
"""

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from validate.pmsm_id.answer import OTHERS, answers_of
from validate.pmsm_id.methods import METHODS
from validate.pmsm_id.of_bench import bench, plant
from validate.pmsm_id.score import scored, table
from validate.pmsm_id.simulated import write_missing, written
from validate.pmsm_id.tasks import FOLDER, tasks


def main() -> None:
    """Do all of it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--motulator", metavar="PYTHON")
    parser.add_argument("--peers", metavar="PYTHON")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time")
    parser.add_argument("methods", nargs="*")
    asked = parser.parse_args()
    write_missing({"bench": bench, "sampled drive": plant})
    missing = {task.number for task in tasks()} - written()
    if missing and asked.motulator:
        subprocess.run([asked.motulator, "-m", "validate.pmsm_id.of_motulator"], check=True)
    names = asked.methods or [*METHODS, *(OTHERS if asked.peers else ())]
    module = "validate.pmsm_id.answer"
    commands = [
        [asked.peers if name in OTHERS else sys.executable, "-m", module, name, str(k), jobs]
        for name in names
        if name in METHODS or (name in OTHERS and asked.peers)
        for k in range(asked.jobs)
        if (jobs := str(asked.jobs))
    ]
    single = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with ThreadPoolExecutor(asked.jobs) as pool:
        list(pool.map(lambda one: subprocess.run(one, check=True, env=single), commands))
    truths = {one["log"]: one for one in json.loads((FOLDER / "truth.json").read_text())}
    given = {name: answers_of(name) for name in names}
    found = {n: [scored(a, truths[k]) for k, a in one.items()] for n, one in given.items() if one}
    print("\n".join(table(found)))


if __name__ == "__main__":
    main()
