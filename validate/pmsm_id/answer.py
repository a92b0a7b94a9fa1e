"""Answer the tasks by a method: ``python -m validate.pmsm_id.answer METHOD [SHARD SHARDS]``.

Runs without penode for the methods of `peers`. Answers that are there are kept.
"""

import importlib
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from validate.pmsm_id.tasks import FOLDER

#: Methods of `peers`, which need no penode; all others are of `methods`.
OTHERS = ("collocation", "jax-sysid")


def methods(name: str) -> Mapping[str, Any]:
    """Return the methods among which a name is."""
    module = "peers" if name in OTHERS else "methods"
    found: Mapping[str, Any] = importlib.import_module(f"validate.pmsm_id.{module}").METHODS
    return found


def answers_of(name: str, folder: Path = FOLDER) -> dict[int, dict[str, Any]]:
    """Return the answers of a method by the number of the log."""
    file = folder / "answers" / f"{name}.jsonl"
    lines = file.read_text().splitlines() if file.exists() else []
    return {one["log"]: one for one in map(json.loads, lines)}


def answer(name: str, shard: int = 0, shards: int = 1, folder: Path = FOLDER) -> None:
    """Answer every log of a shard that has no answer yet."""
    method, file = methods(name)[name], folder / "answers" / f"{name}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = answers_of(name, folder)
    for told in json.loads((folder / "tasks.json").read_text())[shard::shards]:
        if told["log"] in known:
            continue
        began = time.perf_counter()
        given = method(folder / told["file"], told, folder / "work" / f"{name} {told['log']}")
        given |= {"log": told["log"], "seconds": round(time.perf_counter() - began, 2)}
        with file.open("a") as lines:
            lines.write(json.dumps(given) + "\n")
        print(f"{name}: {told['file']}, {given['seconds']:.1f} s", flush=True)


if __name__ == "__main__":
    answer(sys.argv[1], *map(int, sys.argv[2:4]))
