"""Animate a climb of the ladder for the landing page: python docs/figures/make_ladder.py."""

from io import BytesIO
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from make_readme import BLUE, INK, draw_ladders, record_and_identify
from PIL import Image

#: Milliseconds of a frame, which ends what moves within 5 s, and samples that are drawn.
FRAME, SAMPLES = 750, 1000


def draw_windows(axes, run, horizon: int) -> None:
    """Draw i_q of a recording, and the windows over which training predicts it."""
    time = 1e3 * run.time_step * np.arange(SAMPLES)
    axes.plot(time, run.channels["i_q"][:SAMPLES], color=INK, lw=1.2)
    if horizon > 4:  # shorter ones are narrower than a line
        for k, first in enumerate(range(0, SAMPLES, horizon)):
            ends = time[first], 1e3 * run.time_step * min(first + horizon, SAMPLES)
            axes.axvspan(*ends, color=BLUE, alpha=0.16 if k % 2 else 0.05, lw=0)
    axes.set(xlim=(0, time[-1]), xlabel="time (ms)", ylabel="recorded i_q (A)")
    length = f"{1e3 * run.time_step * horizon:.3g} ms"
    axes.set_title(f"Windows of H = {horizon} samples, {length}", loc="left", fontsize=10)


def draw_climb(axes, ladders, horizon: int) -> None:
    """Draw R of the rungs up to a horizon, on axes that all of them have room on."""
    draw_ladders(axes, [[one for one in ladder if one.horizon <= horizon] for ladder in ladders])
    every = [rung for ladder in ladders for rung in ladder]
    low, high = (1e3 * f(r.parameters["R"] for r in every) for f in (min, max))
    room = 0.15 * (high - low)
    axes.set(xlim=(0.8, 1.4 * every[-1].horizon), ylim=(low - room, high + room))
    axes.legend(frameon=False, fontsize=9, loc="lower right")
    axes.set_title("Resistance after training at H", loc="left", fontsize=10)


def frame(run, ladders, horizon: int) -> Image.Image:
    """Return one picture of the climb."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained")
    draw_windows(left, run, horizon)
    draw_climb(right, ladders, horizon)
    picture = BytesIO()
    figure.savefig(picture, dpi=100)
    plt.close(figure)
    return Image.open(picture).convert("RGB")


def main() -> None:
    """Identify with both maps and write one frame a horizon."""
    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    run, fits = record_and_identify()
    ladders = [fit.horizon.ladder for fit in fits]
    horizons = sorted({rung.horizon for ladder in ladders for rung in ladder})
    frames = [frame(run, ladders, horizon) for horizon in horizons]
    frames[0].save(
        Path(__file__).with_name("ladder.webp"),
        save_all=True,
        append_images=frames[1:],
        duration=FRAME,
        loop=1,
        quality=70,
    )


if __name__ == "__main__":
    main()
