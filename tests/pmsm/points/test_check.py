"""What operating points determine, and what would make them surer, beside what then does."""

from dataclasses import replace

import numpy as np
import pytest
from tests.pmsm.points.test_operating_points import L_D, L_Q, LOST, PSI, STUDY, R, measured

from penode import Experiment
from penode.fit.outcome import NORMAL_95
from penode.pmsm import check_points
from penode.pmsm.points.check import _simulated
from penode.pmsm.points.identify import identify_points


def half_width(points):
    estimate = identify_points(points, STUDY).parameters["R"]
    return NORMAL_95 * estimate.std / estimate.value


@pytest.mark.slow
def test_what_is_measured_makes_the_answer_as_sure_as_was_said():
    points = measured(torque=False, noise=0.3)
    check = check_points(points, STUDY)
    assert check.good
    assert check.half_width == pytest.approx(half_width(points))
    slow, torque = check.would_bring.values()
    assert max(slow, torque) < check.half_width
    assert torque == pytest.approx(half_width(measured(noise=0.3)), rel=0.2)


def test_what_is_simulated_is_what_the_machine_found_says_at_any_speed():
    points, slow = measured(torque=False), measured(torque=False)
    fit, random = identify_points(points, STUDY), np.random.default_rng(0)
    slow = Experiment("p", 1.0, slow.channels | {"omega_el": 0.1 * slow.channels["omega_el"]})
    i = points.channels["i_d"] + 1j * points.channels["i_q"]
    psi = PSI + L_D * i.real + 1j * L_Q * i.imag
    for one in (points, slow):
        made = _simulated(one, STUDY, fit, np.zeros(2), random).channels
        exact = R * i + LOST * i / np.abs(i) + 1j * one.channels["omega_el"] * psi
        gap = np.abs(made["u_d"] + 1j * made["u_q"] - exact)
        assert gap.max() < 0.02 * np.abs(exact).max()


def test_one_speed_one_side_and_a_line_of_currents_are_named():
    points = measured(count=60)
    kept = (points.channels["omega_el"] == 300.0) & (points.channels["i_q"] > 0)
    rows = {name: one[kept] for name, one in points.channels.items()}
    told = " ".join(check_points(Experiment("points.csv", 1.0, rows), STUDY).coverage)
    assert "one speed only" in told
    assert "one sign of i_q only" in told
    both = " ".join(check_points(points, STUDY).coverage)
    assert "only" not in both
    assert "electrical speed 2864.8 to 8594.4 rpm" in both
    shaft = check_points(points, replace(STUDY, of_shaft=("omega_el",)))
    assert shaft.coverage[-1] == shaft.fit.warnings[0]
    rows["winding_temperature"] = np.linspace(20, 80, len(rows["i_d"]))
    warm = " ".join(check_points(Experiment("points.csv", 1.0, rows), STUDY).coverage)
    assert "winding_temperature varies by 60.0 K" in warm
