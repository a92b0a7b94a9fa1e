"""One picture of a simulated recording: trajectory, voltages, spectra, harmonics over the angle."""

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from penode.arrays import FloatArray, float64, on_device
from penode.bench.coenergy_table import tabulate
from penode.bench.run import Recording
from penode.report.png import D_AXIS, Q_AXIS, png


def recording_picture(recording: Recording) -> bytes:
    """Return a PNG of a recording.

    Currents over the disc, voltages over time, spectra of the currents over the electrical order,
    and the flux linkage's harmonics over the angle at three points of the disc.
    """
    figure = Figure(figsize=(11, 8), layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    drawings = (_draw_disc, _draw_voltages, _draw_spectrum, _draw_harmonics)
    for axes, draw in zip(panels, drawings, strict=True):
        draw(axes, recording)
    return png(figure, panels, recording.experiment.name)


def _draw_disc(axes: Axes, recording: Recording) -> None:
    limit = recording.truth.machine.current_limit
    currents = recording.experiment.stack(("i_d", "i_q"))
    angle = np.linspace(0, 2 * np.pi, 181)
    axes.plot(limit * np.cos(angle), limit * np.sin(angle), color="0.7", lw=1)
    axes.plot(*currents.T, color=D_AXIS, lw=0.4)
    axes.set(aspect="equal", xlabel="i_d (A)", ylabel="i_q (A)")
    axes.set_title(f"Currents over the disc, limit {limit:.0f} A", loc="left", fontsize=10)


def _draw_voltages(axes: Axes, recording: Recording) -> None:
    run = recording.experiment
    time = np.arange(len(run)) * run.time_step
    every = max(len(run) // 8000, 1)
    for name, colour in (("u_d", D_AXIS), ("u_q", Q_AXIS)):
        axes.plot(time[::every], run.channels[name][::every], color=colour, lw=0.6, label=name)
    axes.set(xlabel="time (s)", ylabel="voltage asked for (V)")
    axes.set_title("Voltages", loc="left", fontsize=10)
    axes.legend(frameon=False, ncols=2, loc="upper right")


def _draw_spectrum(axes: Axes, recording: Recording) -> None:
    run = recording.experiment
    taper = np.hanning(len(run))
    speed = float(np.abs(np.mean(run.channels["omega_el"])))
    order = 2 * np.pi * np.fft.rfftfreq(len(run), run.time_step) / max(speed, 1e-9)
    shown = order <= 26
    for name, colour in (("i_d", D_AXIS), ("i_q", Q_AXIS)):
        lines = 2 * np.abs(np.fft.rfft(run.channels[name] * taper)) / taper.sum()
        axes.semilogy(order[shown], lines[shown] + 1e-9, color=colour, lw=0.7, label=name)
    axes.set(xlabel="electrical order in dq", ylabel="amplitude (A)", xlim=(0, 26), ylim=1e-5)
    axes.set_xticks([0, 1, 2, 6, 12, 18, 24])
    axes.set_title("Spectrum of the currents", loc="left", fontsize=10)
    axes.legend(frameon=False, ncols=2, loc="upper right")


def _draw_harmonics(axes: Axes, recording: Recording) -> None:
    machine = recording.truth.machine
    angle = np.linspace(0, np.pi / 3, 41)
    reach = 0.7 * machine.current_limit
    for point, style in (((0.0, 0.0), "-"), ((-reach / 2, reach / 2), "--"), ((0.0, reach), ":")):
        ripple = 1e3 * _ripple(recording, point, angle)
        label = f"at ({point[0]:.0f}, {point[1]:.0f}) A"
        axes.plot(np.degrees(angle), ripple[0], style, color=D_AXIS, lw=1, label=f"ψ_d {label}")
        axes.plot(np.degrees(angle), ripple[1], style, color=Q_AXIS, lw=1, label=f"ψ_q {label}")
    axes.set(xlabel="electrical angle (°)", ylabel="flux linkage less its mean (mVs)")
    axes.set_title("Harmonics over the angle", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.15))


def _ripple(recording: Recording, point: tuple[float, float], angle: FloatArray) -> FloatArray:
    """Return psi (2, angle) in Vs less its mean over the angle, at one pair of currents in A."""
    with float64():
        table, current = tabulate(recording.truth.machine), on_device(point)
        moments = [table(current, theta).linkage for theta in on_device(angle)]
        linkage = np.asarray(jnp.stack(moments, axis=1))
    return np.asarray(linkage - linkage.mean(axis=1, keepdims=True))
