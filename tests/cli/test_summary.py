"""The last lines of a command: numbers with units, warnings, files; and how options are read."""

import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from penode.cli.fits import print_demo, print_fit
from penode.cli.options import given, whole_numbers
from penode.errors import InputError
from penode.fit.outcome import Contribution, Estimate, HorizonChoice
from penode.pmsm.machine.temperatures import RECORDED
from penode.validation.comparison import Comparison

ROWS = (Contribution("gain", 8e-5, "0.8 %"), Contribution("statistics", 6e-5))
WAVE = np.tile([1.0, -1.0], 50)[:, None]


def compared(name, role, units=("A",), free=0.25):
    states = ("i_d", "n")[: len(units)]
    measured = np.zeros((100, len(units)))
    parts = (measured, measured + 0.125 * WAVE, measured + free * WAVE)
    return Comparison(name, role, 1e-4, states, units, *parts)


@pytest.fixture
def fit():
    recordings = (compared("a.csv", "train"), compared("b.csv", "validation", ("A", "rad/s")))
    return SimpleNamespace(
        parameters={
            "R": Estimate.of(10e-3, 1e-4, "ohm", budget=ROWS),
            "L": Estimate.of(0.5, 0.012, ""),
        },
        horizon=HorizonChoice(8, "plateau", "Three agree.", ()),
        recordings=recordings,
        warnings=("First [sic].", "Second."),
        provenance={"structure": ("The voltage acts late.",)},
        stationary=None,
        model=None,
    )


def lines(show, *what):
    """Return what is printed into a pipe, as pairs of label and sentence."""
    console = Console(file=io.StringIO(), width=20)
    show(*what, console)
    printed = console.file.getvalue()
    assert "\N{NO-BREAK SPACE}" not in printed
    return [tuple(line.split(maxsplit=1)) for line in printed.splitlines()]


def test_a_fit_is_told_in_labelled_lines(fit):
    assert lines(print_fit, fit, Path("out")) == [
        ("R", "10.00 mΩ, 95 % interval 9.80 to 10.20 mΩ"),
        ("L", "0.500, 95 % interval 0.476 to 0.524"),
        ("budget", "R: half width 2.0 %: gain 1.6 % (std 0.8 %), the data alone 1.2 %"),
        ("verdict", "The data can answer (verdict: plateau). Three agree."),
        ("horizon", "8 steps"),
        ("model", "The voltage acts late."),
        (
            "train",
            "a.csv: RMSE one step from a noisy sample 0.125 A; free run 0.250 A (25 % of the "
            "largest value)",
        ),
        (
            "validation",
            "b.csv: RMSE one step from a noisy sample i_d 0.125 A, n 0.125 rad/s; "
            "free run i_d 0.250 A, n 0.250 rad/s (25 % of the largest value)",
        ),
        ("warning", "First [sic]."),
        ("warning", "Second."),
        ("map", "out/flux_map.csv"),
    ]


def test_without_an_answer_no_value_stands_as_one(fit):
    """Nor an interval that nobody can read, nor what it is made of."""
    fit.horizon = HorizonChoice(8, "implausible", "It is not.", ())
    told = lines(print_fit, fit, Path("out"))
    assert ("R", "no answer; must not be used: 10.00 mΩ, 95 % interval 9.80 to 10.20 mΩ") in told
    assert "budget" in dict(told)
    fit.parameters["R"] = Estimate.of(10e-3, 5e11, "ohm", budget=ROWS)
    told = lines(print_fit, fit, Path("out"))
    assert told[0] == (
        "R",
        "no answer; must not be used: 10 mΩ, its interval too wide to mean anything",
    )
    assert "budget" not in dict(told)


def test_a_machine_without_a_band_is_told_flux_linkage_and_inductances_alone(machine_fit):
    told = dict(lines(print_fit, machine_fit, Path("out")))
    psi = 1e3 * machine_fit.flux_map(0.0, 0.0)[0]
    assert told["psi_PM"] == f"{psi:.1f} mVs, at no current"
    slope = 1e6 * np.diag(machine_fit.differential_inductance(0.0, 0.0))
    assert (told["L_d"], told["L_q"]) == tuple(f"{one:.0f} µH, at no current" for one in slope)
    assert "winding" not in told
    known = {**machine_fit.provenance, RECORDED: {"winding_temperature": (41.0, 40.0, 42.0)}}
    told = dict(lines(print_fit, replace(machine_fit, provenance=known), Path("out")))
    of = "R is that of the winding, with cable and switches where the voltages are commands,"
    assert told["winding"] == f"{of} at 41 °C (recorded: 40 to 42)."
    known = {**machine_fit.provenance, RECORDED: {"winding_temperature": (41.0, 41.0, 41.0)}}
    told = dict(lines(print_fit, replace(machine_fit, provenance=known), Path("out")))
    assert told["winding"] == f"{of} at 41 °C."


@pytest.mark.parametrize(("verdict", "colour"), [("plateau", 32), ("implausible", 31)])
def test_a_verdict_is_green_or_red_and_one_step_is_no_plural(fit, verdict, colour):
    fit.horizon = replace(fit.horizon, verdict=verdict, selected=1)
    console = Console(file=io.StringIO(), width=200, force_terminal=True, color_system="standard")
    print_fit(fit, Path("out"), console)
    can = "can" if verdict == "plateau" else "cannot"
    label = f"The data {can} answer (verdict: {verdict})"
    assert f"\x1b[{colour}m{label}\x1b[0m. Three agree." in console.file.getvalue()
    assert " 1 step " in console.file.getvalue()


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (10.0000001e-3, "R = 10.00 mΩ: error +0.00 %, inside the interval"),
        (10.1e-3, "R = 10.10 mΩ: error -0.99 %, inside the interval"),
        (10.2e-3, "R = 10.20 mΩ: error -1.96 %, OUTSIDE the interval"),
        (9.79e-3, "R = 9.790 mΩ: error +2.15 %, OUTSIDE the interval"),
    ],
)
def test_the_demo_says_how_far_it_is_from_the_truth(fit, truth, said):
    machine = SimpleNamespace(resistance=truth)
    demo = SimpleNamespace(fit=fit, machine=machine, flux_error=2.5e-4, flux_share=0.0125)
    assert lines(print_demo, demo) == [
        ("truth", said),
        ("truth", "flux linkage: mean absolute error 0.250 mVs, 1.25 % of the magnet's"),
    ]


# --- options ----------------------------------------------------------------------------------


def test_options_that_did_not_come_overrule_nothing():
    assert given(flux_map=None, inverter=False, hold="dq") == {"inverter": False, "hold": "dq"}
    assert given(terms="resistance, iron ,dead_time") == {
        "terms": ["resistance", "iron", "dead_time"]
    }


@pytest.mark.parametrize(
    ("text", "orders"), [("", ()), ("none", ()), ("6", (6,)), ("6, 12,-3", (6, 12, -3))]
)
def test_harmonics_are_numbers_or_none(text, orders):
    assert given(angle_orders=text) == {"angle_orders": orders}


def test_what_is_no_whole_number_is_told_with_what_may_come():
    with pytest.raises(InputError, match=r"must be none, or whole .* got 6,x"):
        given(angle_orders="6,x")
    with pytest.raises(InputError, match=r"^--horizons must be whole .*1\.5"):
        whole_numbers("horizons", "1.5")
