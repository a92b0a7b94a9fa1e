"""Two fits, or a fit and a map file, held against each other."""

from dataclasses import replace

import numpy as np
import pytest

from penode.errors import InputError
from penode.fit.fit import Estimate
from penode.fit.outcome import Contribution
from penode.pmsm.comparison.comparison_picture import comparison_picture
from penode.pmsm.comparison.map_comparison import compare_maps, compare_resistances
from penode.pmsm.machine.flux_grid import read_grid, tabulate
from penode.pmsm.machine.temperatures import RECORDED
from penode.pmsm.result_files import flux_map_csv
from penode.report.quantities import number


def warmer(fit, shift=-2e-3, resistance=0.01, width=2e-4):
    """Return the fit with psi_d shifted in Vs and another resistance."""
    network = fit.model.flux.network
    offset = network.offset + np.array([shift, 0.0]) / fit.model.flux.flux_scale
    flux = replace(fit.model.flux, network=replace(network, offset=offset))
    interval = (resistance - width, resistance + width)
    estimate = Estimate(resistance, width / 2, interval, "ohm", 0.9)
    return replace(fit, model=replace(fit.model, flux=flux), parameters={"R": estimate})


def test_a_shift_of_the_magnet_is_told_in_mvs_and_in_shares(machine_fit):
    comparison = compare_maps(machine_fit, warmer(machine_fit))
    assert comparison.rms == pytest.approx(2e-3, rel=1e-9)
    assert comparison.largest == pytest.approx(2e-3, rel=1e-9)
    at_zero = np.hypot(*machine_fit.flux_map(0.0, 0.0))
    assert comparison.no_current_flux == pytest.approx(at_zero)
    assert "2.00 mVs" in comparison.sentence
    assert f"({100 * 2e-3 / at_zero:.1f} %)" in comparison.sentence


def test_only_currents_that_both_support_are_compared(machine_fit):
    half = replace(machine_fit, excited=machine_fit.excited[machine_fit.excited[:, 1] > 0])
    comparison = compare_maps(machine_fit, half)
    i_d, i_q = np.meshgrid(comparison.i_d, comparison.i_q, indexing="ij")
    known = np.isfinite(comparison.difference).all(axis=0)
    points = np.stack([i_d, i_q], axis=-1)[known]
    assert half.supported(points).all()
    assert machine_fit.supported(points).all()
    assert comparison.i_q.min() > 0


def test_a_file_is_compared_at_its_own_points(machine_fit, tmp_path):
    path = tmp_path / "flux_map.csv"
    path.write_text(flux_map_csv(machine_fit))
    comparison = compare_maps(machine_fit, read_grid(path))
    assert comparison.largest < 1e-9
    shifted = compare_maps(warmer(machine_fit), read_grid(path))
    assert shifted.rms == pytest.approx(2e-3, rel=1e-6)
    grid = tabulate(machine_fit, 21)
    assert compare_maps(machine_fit, grid).largest == 0


def test_resistances_at_two_temperatures_are_compared_at_one(machine_fit):
    """Copper: 0.393 % a kelvin of what it is at 20 degC."""
    kelvin = 0.00393
    estimate = machine_fit.parameters["R"]
    warm, cold = (
        replace(
            machine_fit,
            provenance={**machine_fit.provenance, RECORDED: {"winding_temperature": (t, t, t)}},
            parameters={"R": Estimate.of((1 + kelvin * (t - 20)) * 0.01, 1e-5, "ohm")},
        )
        for t in (60.0, 30.0)
    )
    assert estimate.unit == "ohm"
    sentence = compare_resistances(warm, cold)
    assert "0.0 % apart with the second brought from 30 to 60 °C as copper" in sentence
    same = compare_resistances(warm, replace(cold, provenance=machine_fit.provenance))
    assert "10 % apart where" in same
    assert "DISAGREE" in same


def test_maps_without_common_currents_are_refused(machine_fit):
    left, right = (
        replace(machine_fit, excited=machine_fit.excited[side])
        for side in (machine_fit.excited[:, 0] < -200, machine_fit.excited[:, 0] > 50)
    )
    with pytest.raises(InputError, match="no current is supported"):
        compare_maps(left, right)


@pytest.mark.parametrize(
    ("resistance", "words"),
    [(0.0101, "they agree"), (0.0105, "DISAGREE"), (0.0105, "in copper that is 13 K")],
)
def test_resistances_are_compared_in_words(machine_fit, resistance, words):
    sentence = compare_resistances(machine_fit, warmer(machine_fit, resistance=resistance))
    assert words in sentence
    assert f"{1e3 * resistance:.1f}" in sentence


def test_the_accuracy_of_the_same_sensors_cancels(machine_fit):
    estimate = machine_fit.parameters["R"]
    data = Contribution("statistics of the residuals", 2e-6)
    gain = Contribution("gain", 1e-4, "1 %", "Calibrate.", "assumed")
    delay = Contribution("delay", 3e-6, "0.1 samples", "Measure it.", "estimated")
    budget, own = (gain, data, delay), np.hypot(2e-6, 3e-6)
    std = float(np.hypot(1e-4, own))
    sure = replace(
        machine_fit, parameters={"R": Estimate.of(estimate.value, std, "ohm", budget=budget)}
    )
    moved = Estimate.of(1.01 * estimate.value, std, "ohm", budget=budget)
    sentence = compare_resistances(sure, replace(sure, parameters={"R": moved}))
    assert "they agree; if both used the same sensors," in sentence
    half = 1.96 * np.hypot(own, own) / estimate.value
    assert (
        f"{number(100 * half, 2)} % may be chance, and they DISAGREE; in copper that is 2.5 K"
        in sentence
    )
    near = Estimate.of(1.0001 * estimate.value, std, "ohm", budget=budget)
    assert compare_resistances(sure, replace(sure, parameters={"R": near})).endswith("agree too")


def test_a_resistance_without_answer_is_not_compared(machine_fit):
    lost = replace(machine_fit, horizon=replace(machine_fit.horizon, verdict="no plateau"))
    assert "cannot be compared" in compare_resistances(machine_fit, lost)
    assert "second" in compare_resistances(machine_fit, lost)


def test_picture_is_png(machine_fit):
    for other in (machine_fit, warmer(machine_fit)):
        comparison = compare_maps(machine_fit, other)
        assert comparison_picture(comparison, "a less b").startswith(b"\x89PNG")
