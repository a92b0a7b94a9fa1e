"""A disk that is full: ``python -m validate.full_disk [COUNT]``, where Linux lets one be mounted.

One short recording is identified into a file system of its own, COUNT times, from one of 4 KiB to
one with more room than a whole result takes; every second time a result of the same recording is
there already. Temporary files go there too. Each has to end with the whole result, or with one
sentence, exit status 2, and what was there before: beside it may stand the finished horizons,
whole, from which --resume goes on, and their log.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.checkpoint_file import read
from validate.interruption import identify

COUNT = 20
_SMALLEST = 4096
#: Mounts a file system of so many bytes at a place that only what follows sees, and begins that.
_MOUNT = 'mount -t tmpfs -o size="$1" none "$2" && shift 2 && exec "$@"'
_MOUNTED = ("unshare", "--map-root-user", "--mount", "sh", "-c", _MOUNT, "sh")


@dataclass(frozen=True)
class Outcome:
    """What became of one: exit status, sentences, and what is there now, in words."""

    status: int
    said: str
    left: str

    @property
    def fine(self) -> bool:
        """Whether it is as it should be."""
        if self.status == 0:
            return self.left == "whole result" and not self.said
        one_sentence = len(self.said.splitlines()) == 1
        return self.status == 2 and one_sentence and self.left in ("as before", "horizons kept")


def files(folder: Path) -> dict[str, str]:
    """Return the digest of every file in a folder, and of folders their names."""
    return {
        str(path.relative_to(folder)): ""
        if path.is_dir()
        else hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
    }


def inside(disk: Path, recording: Path, earlier: Path | None) -> Outcome:
    """Identify into a small disk, which this process alone sees."""
    out, temporary = disk / "out", disk / "temporary"
    temporary.mkdir()
    os.environ["TMPDIR"] = str(temporary)
    if earlier is not None:
        subprocess.run(["cp", "-r", str(earlier), str(out)], check=True)
    before = files(disk)
    ended = identify(recording, out, "--overwrite")
    return Outcome(ended.status, ended.said.strip(), left(disk, before, ended.status))


def left(disk: Path, before: dict[str, str], status: int) -> str:
    """Say what is on a disk after an identification."""
    after = files(disk)
    changed = {name for name, digest in after.items() if before.get(name) != digest}
    gone = before.keys() - after.keys()
    if not changed and not gone:
        return "as before"
    others = changed - {"out", "out/fit", "out/fit/checkpoint.json", "out/events.jsonl"}
    if status and not others and not gone and read(disk / "out/fit/checkpoint.json"):
        return "horizons kept"
    try:
        result = Fit.load(disk / "out").horizon.verdict
    except InputError as error:
        result = str(error)
    hidden = [name for name in after if "/." in name or "checkpoint" in name]
    return "whole result" if not status and not hidden else f"{result}, {sorted(changed | gone)}"


def on_disk(size: int, folder: Path, earlier: Path | None) -> Outcome:
    """Identify into a disk of so many bytes."""
    disk = folder / "disk"
    disk.mkdir(exist_ok=True)
    paths = [str(path) for path in (disk, folder / "run.csv", earlier) if path is not None]
    command = [*_MOUNTED, str(size), str(disk), sys.executable, "-m", __spec__.name, "inside"]
    done = subprocess.run([*command, *paths], stdout=subprocess.PIPE, check=True)
    return Outcome(**json.loads(done.stdout))


def main(count: int = COUNT) -> None:
    """Print a row a disk, and end with status 1 if one is not as it should be."""
    good = []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        reference = Lissajous(240.0, 50.0, 54.0)
        run = simulate(TRACTION_300A, reference, speed_rpm=1500.0, duration=0.25)
        save(run, folder / "run.csv")
        identify(folder / "run.csv", folder / "whole")
        taken = sum(path.stat().st_size for path in (folder / "whole").rglob("*.*"))
        print(f"a whole result takes {taken / 1024:.0f} KiB\n   KiB  before  status  left")
        for number, size in enumerate(np.geomspace(_SMALLEST, 2.5 * taken, count).astype(int)):
            # Of those with a result the disk has room for it beside what is written.
            earlier = folder / "whole" if number % 2 else None
            room = int(size) + (taken + (64 << 10) if earlier else 0)
            end = on_disk(room, folder, earlier)
            there, verdict = "result" if earlier else "empty", "" if end.fine else "   WRONG"
            state = f"{room / 1024:6.0f}  {there:6s}  {end.status:6d}  {end.left:13s}"
            print(f"{state}  {end.said}{verdict}", flush=True)
            good.append(end.fine)
    print(f"{sum(good)} of {len(good)} as they should be")
    sys.exit(not all(good))


if __name__ == "__main__":
    if sys.argv[1:2] == ["inside"]:
        given = [Path(one) for one in sys.argv[2:]]
        print(json.dumps(asdict(inside(given[0], given[1], given[2] if given[2:] else None))))
    else:
        main(*map(int, sys.argv[1:]))
