"""One picture of a simulated drive over time: currents, voltages and torque."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from penode.bench.run import Recording
from penode.data.experiment import Experiment
from penode.pmsm.simulation.simulated_drive import torque_of
from penode.report.png import D_AXIS, Q_AXIS, png

_COLOURS = {"d": D_AXIS, "q": Q_AXIS}
# Points of a curve: more than a picture has columns.
_POINTS = 4000


def drive_picture(recording: Recording, recorded: Experiment | None = None) -> bytes:
    """Return a PNG of a simulation, before a recording on the same reference where there is one.

    Currents in A, voltages asked for in V, and air-gap torque in Nm, over time in s.
    """
    figure = Figure(figsize=(11, 8), layout="constrained")
    currents, voltages, newton_metres = figure.subplots(3, 1, sharex=True)
    _draw(currents, recording, recorded, "i")
    currents.set(ylabel="current (A)")
    _draw(voltages, recording, recorded, "u")
    voltages.set(ylabel="voltage asked for (V)")
    run = recording.experiment
    every = max(len(run) // _POINTS, 1)
    time = np.arange(len(run))[::every] * run.time_step
    newton_metres.plot(time, torque_of(recording)[::every], color="0.2", lw=0.8)
    newton_metres.set(ylabel="air-gap torque (Nm)", xlabel="time (s)")
    panels = (currents, voltages, newton_metres)
    for axes in panels:
        axes.margins(x=0)
    return png(figure, panels, run.name)


def _draw(axes: Axes, recording: Recording, recorded: Experiment | None, kind: str) -> None:
    run = recording.experiment
    rows = len(run) if recorded is None else min(len(run), len(recorded))
    every = max(len(run) // _POINTS, 1)
    for axis, colour in _COLOURS.items():
        name = f"{kind}_{axis}"
        if recorded is not None:
            time = np.arange(rows)[::every] * recorded.time_step
            values = recorded.channels[name][:rows][::every]
            label = f"{name}, {recorded.name}"
            axes.plot(time, values, color=colour, lw=2.5, alpha=0.35, label=label)
        time = np.arange(len(run))[::every] * run.time_step
        axes.plot(time, run.channels[name][::every], color=colour, lw=0.8, label=name)
    axes.legend(frameon=False, ncols=4, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
