"""Make the outputs and pictures of the gallery: python docs/gallery/make_gallery.py [NAME...].

It needs Chromium for the pictures of reports; without one, what is there stays.
"""

import contextlib
import io
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from penode import Experiment
from penode.bench import TRACTION_300A, Lissajous, simulate

HERE = Path(__file__).parent
PAGES = HERE.parent / "how-to"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
COLUMNS = 100


def typed(name: str, *commands: str) -> None:
    """Run commands and keep what they print, as a person sees it."""
    shown = []
    for command in commands:
        program, *arguments = command.split()
        done = subprocess.run(
            [str(Path(sys.executable).with_name(program)), *arguments],
            capture_output=True,
            text=True,
            env={**os.environ, "COLUMNS": str(COLUMNS), "NO_COLOR": "1"},
        )
        shown += [f"$ {command}", done.stderr.rstrip(), done.stdout.rstrip()]
        if done.returncode:
            shown.append(f"(exit status {done.returncode})")
    text = "\n".join(line.rstrip() for line in "\n".join(filter(None, shown)).splitlines())
    (HERE / f"{name}.txt").write_text(text + "\n")


def pictured(name: str, page: str, dark: bool = False) -> None:
    """Keep a picture of the top of a report."""
    if CHROMIUM is None:
        return
    shot = Path(f"{name}.png").resolve()
    subprocess.run(
        [
            *(CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"),
            *(f"--screenshot={shot}", "--window-size=1400,1500", "--virtual-time-budget=20000"),
            *(("--blink-settings=preferredColorScheme=0",) if dark else ()),
            Path(page).resolve().as_uri(),
        ],
        capture_output=True,
        check=True,
    )
    kept(shot)


def kept(picture: Path) -> None:
    """Keep a picture, small enough for a repository."""
    image = Image.open(picture).convert("RGB")
    image.thumbnail((1400, 1600))
    image.save(HERE / f"{picture.stem}.webp", quality=82, method=6)


def good() -> None:
    """Show the demo."""
    typed("good", "penode demo --out good")
    pictured("good", "good/report.html")


def refused() -> None:
    """Show a recording whose u_q has the wrong sign: the refusal, and the page of a training."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 50.0, 54.0), speed_rpm=1500.0, duration=0.5)
    columns = {"t": run.time_step * np.arange(len(run)), **run.channels}
    columns["u_q"] = -columns["u_q"]
    rows = np.column_stack(list(columns.values()))
    np.savetxt("wrong.csv", rows, delimiter=",", header=",".join(columns), comments="")
    typed(
        "refused",
        "penode identify wrong.csv --out wrong",
        "penode identify wrong.csv --out wrong --train-anyway",
    )
    pictured("refused", "wrong/report.html")


def bench() -> None:
    """Show a simulated test bench, every imperfection on, and what check says of it."""
    typed(
        "bench",
        "penode simulate paper_testbench --out bench.csv --picture bench.png",
        "penode check bench.csv --picture cover.png",
    )
    kept(Path("bench.png"))
    kept(Path("cover.png"))


def noisy(run: Experiment) -> Experiment:
    """Return a recording with noise of 1 % of each measured state."""
    random = np.random.default_rng(0)
    noise = {
        name: 0.01 * values.std() * random.standard_normal(len(values))
        for name, values in run.channels.items()
        if name != "force"
    }
    return replace(
        run, channels={**run.channels, **{n: run.channels[n] + e for n, e in noise.items()}}
    )


def own() -> None:
    """Show the page on own physics, its recording with noise of 1 %, and the ladder of its fit."""
    blocks = (PAGES / "own-physics.md").read_text().split("```python\n")[1:4]
    namespace: dict[str, object] = {"__name__": "__main__"}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for block in blocks:
            exec(block.split("```")[0].split("\nassert ")[0], namespace)
            if "run" in namespace and "fit" not in namespace:
                namespace["run"] = noisy(namespace["run"])
        print(namespace["fit"])
    (HERE / "own.txt").write_text(printed.getvalue())
    namespace["fit"].plot_ladder().savefig("own.png", dpi=130)  # type: ignore[attr-defined]
    kept(Path("own.png"))


MADE: dict[str, Callable[[], None]] = {"good": good, "refused": refused, "bench": bench, "own": own}


def main() -> None:
    """Make all of the gallery, or what is named, in a folder that vanishes."""
    names = sys.argv[1:] or list(MADE)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name in names:
            MADE[name]()


if __name__ == "__main__":
    main()
