"""Public sets by penode and by others: ``python -m benchmarks.peers [FOLDER] [NAME...]``.

The others get the same models, recordings and starts, and estimate the start of the recording too;
what they need beside was chosen by hand, for the best score (`benchmarks.peer_models`): the hold,
guesses and scales of what is not measured. Each runs in a process of its own. Printed are the free
run's error on the test with its start estimated, the same for all; the seconds from recording to
answer, cold (with all that is built and compiled) and again in the same process; and lines of code
of model and of method.

CasADi and jax-sysid need an environment of their own; see benchmarks/requirements.txt.
"""

import inspect
import io
import json
import os
import subprocess
import sys
import time
import tokenize
from pathlib import Path
from typing import Any

import numpy as np
from validate.public_sets import FOLDER, PLAIN, SETS, PublicSet, errors, scaled_errors

from penode import identify

#: After so many seconds a method is stopped.
LONGEST = float(os.environ.get("PENODE_PEER_SECONDS", "600"))
METHODS = {
    "penode": "penode, for simulation",
    "scipy": "least_squares on CasADi, single shooting",
    "shooting": "CasADi, IPOPT, multiple shooting",
    "collocation": "CasADi, IPOPT, collocation",
    "diffrax": "diffrax, optimistix LM",
    "jax-sysid": "jax-sysid, L-BFGS",
}


def lines_of(*parts: Any) -> int:
    """Return how many lines hold code, not counting what is blank, a comment or a docstring."""
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    rows = 0
    for part in parts:
        tokens = list(tokenize.generate_tokens(io.StringIO(inspect.getsource(part)).readline))
        code, fresh = set(), True
        for token in tokens:
            if token.type in skipped or token.type == tokenize.ENDMARKER:
                fresh = fresh or token.type == tokenize.NEWLINE
            elif not (fresh and token.type == tokenize.STRING):
                code |= set(range(token.start[0], token.end[0] + 1))
                fresh = False
        rows += len(code)
    return rows


def by_penode(one: PublicSet) -> tuple[list[float], list[float], list[int]]:
    """Return errors on the test, cold and warm seconds, and lines of model and method."""
    seconds = []
    for _ in range(2):
        began = time.perf_counter()
        fit = identify(one.start, [one.train, *one.beside], purpose="simulation")
        seconds.append(time.perf_counter() - began)
    return errors(one, fit), seconds, [lines_of(type(one.start)), 1]


def by_peer(
    name: str, method: str, one: PublicSet
) -> tuple[list[float], list[float], list[int], list[float]]:
    """Return the same of a peer, and the parameters it found."""
    from benchmarks import peer_casadi  # CasADi is not installed everywhere
    from benchmarks.peer_models import MODELS, Problem, problem_of

    if method in ("diffrax", "jax-sysid"):
        from benchmarks import peer_jax

        make = {"diffrax": peer_jax.DiffraxOptimistix, "jax-sysid": peer_jax.JaxSysid}[method]
        parts: list[Any] = [make]
    else:
        make = {
            "scipy": peer_casadi.SingleShooting,
            "shooting": peer_casadi.MultipleShooting,
            "collocation": peer_casadi.Collocation,
        }[method]
        parts = [*{make, *make.__mro__[:-1]}, peer_casadi.field]
        parts += [] if method == "collocation" else [peer_casadi.step]
    problem: Any = problem_of(name, one, one.train)
    if one.beside:
        if method != "scipy":
            raise SystemExit("written for one recording")
        make = peer_casadi.SeveralRecordings
        problem = [problem, *(problem_of(name, one, run) for run in one.beside)]
    seconds, began = [], time.perf_counter()
    solver = make(problem)
    for _ in range(2):
        found = solver.solve()
        seconds.append(time.perf_counter() - began)
        began = time.perf_counter()
    test = problem_of(name, one, one.test).with_parameters(found.start)
    gap = peer_casadi.free_run(test)[:, test.rows] - test.outputs
    units = [unit for unit in one.units if unit]
    error = scaled_errors(units, gap)
    lines = [lines_of(MODELS[name].derivative), lines_of(*parts, Problem.parameters)]
    return error, seconds, lines, found.start.tolist()


def work(folder: Path, name: str, method: str) -> None:
    """Print what one method finds of one set, as JSON."""
    one = SETS[name](folder)
    found = by_penode(one) if method == "penode" else by_peer(name, method, one)
    print(json.dumps(found))


def text_of(name: str, method: str, folder: Path) -> str:
    """Run one method on one set and return its line."""
    head = f"{name:15s} {METHODS[method]:42s}"
    command = [sys.executable, "-m", "benchmarks.peers", "--work", str(folder), name, method]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return f"{head} no answer in {LONGEST:.0f} s"
    if ended.returncode:
        said = (ended.stderr.strip() or "no word").splitlines()[-1]
        return f"{head} failed: {said}"
    error, (cold, warm), (model, rest), *_ = json.loads(ended.stdout.strip().splitlines()[-1])
    score = " / ".join(f"{e:.4g}" if np.isfinite(e) else "diverged" for e in error)
    return f"{head} {score:18s} {cold:7.1f} s {warm:7.1f} s  {model:3d} + {rest:3d} lines"


def main(arguments: list[str]) -> None:
    """Print a line for each set and method."""
    if arguments[:1] == ["--work"]:
        work(Path(arguments[1]), *arguments[2:])
        return
    folder = Path(arguments[0]) if arguments else FOLDER
    names = arguments[1:] or list(PLAIN)
    methods = [name for name in names if name in METHODS] or list(METHODS)
    print(f"{'set':15s} {'method':42s} {'error on the test':18s} {'cold':>9s} {'warm':>9s}")
    for name in names:
        for method in methods if name in SETS else ():
            print(text_of(name, method, folder), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
