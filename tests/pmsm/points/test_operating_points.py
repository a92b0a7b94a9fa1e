"""Operating points: the balance against closed forms, the table, the command."""

from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment, InputError
from penode.fit.outcome import IMPLAUSIBLE, NORMAL_95
from penode.pmsm import Accuracy, Study, TemperatureResistance
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.terms import MagnetTemperature
from penode.pmsm.points.balance import PointsSolution, contributions, left_out, mixed
from penode.pmsm.points.identify import ANSWERED, identify_points

R, PSI, L_D, L_Q, PAIRS, LOST, DRAG = 0.05, 0.06, 0.2e-3, 0.5e-3, 4, 1.5, 0.8
STUDY = Study(pole_pairs=PAIRS)


def measured(count=40, seed=0, noise=0.02, resistance=R, torque=True, late=0.0):
    """Return points of a linear machine behind an inverter that takes a voltage, at two speeds."""
    random = np.random.default_rng(seed)
    current = np.sqrt(random.uniform(0.01, 1, count)) * 200
    i = current * np.exp(1j * random.uniform(0.45 * np.pi, 1.6 * np.pi, count))
    speed = np.where(np.arange(count) % 2, 300.0, 900.0)
    psi = PSI + L_D * i.real + 1j * L_Q * i.imag
    u = resistance * i + LOST * i / np.abs(i) + 1j * speed * psi
    u = u * np.exp(1j * speed * late)
    u = u + noise * (random.normal(size=count) + 1j * random.normal(size=count))
    channels = {"u_d": u.real, "u_q": u.imag, "i_d": i.real, "i_q": i.imag, "omega_el": speed}
    if torque:
        shaft = 1.5 * PAIRS * np.imag(np.conj(psi) * i) - DRAG
        channels["torque"] = shaft + 0.05 * random.normal(size=count)
    return Experiment("points.csv", 1.0, channels)


@pytest.fixture(scope="module")
def fit():
    return identify_points(measured(), STUDY)


def test_nothing_is_said_of_usual_points(fit):
    assert fit.warnings == ()


@pytest.mark.parametrize(
    ("torque", "said"),
    [(True, "1/pole_pairs, and the torque is the same with any."), (False, "as 1/pole_pairs.")],
)
def test_pole_pairs_that_a_shaft_s_speed_cannot_show_are_said(torque, said):
    study = replace(STUDY, of_shaft=("omega_el",))
    (note,) = identify_points(measured(torque=torque), study).warnings
    assert note.startswith(f"pole_pairs = {PAIRS} is taken as given")
    assert note.endswith(said)


@pytest.mark.parametrize("left", [0.0, -LOST])
def test_an_inverter_that_compensates_too_much_and_a_recording_are_said(left):
    points = measured(count=1200)
    i = points.channels["i_d"] + 1j * points.channels["i_q"]
    less = (LOST - left) * i / np.abs(i)
    channels = dict(points.channels)
    channels |= {"u_d": channels["u_d"] - less.real, "u_q": channels["u_q"] - less.imag}
    fit = identify_points(Experiment("p.csv", 1.0, channels), STUDY)
    assert abs(fit.parameters["inverter_voltage"].value - left) < 0.5
    many, *negative = fit.warnings
    assert many.startswith("p.csv: 1200 rows without a time are taken as operating points")
    assert [note[:28] for note in negative] == ["inverter_voltage is negative"] * (left < 0)


def test_a_linear_machine_is_found_with_its_inverter(fit):
    assert fit.horizon.verdict == ANSWERED
    assert fit.horizon.selected == 0
    for name, true in {"R": R, "inverter_voltage": LOST}.items():
        low, high = fit.parameters[name].interval_95
        assert low < true < high
    i = measured().stack(("i_d", "i_q"))
    assert fit.supported(i).all()
    assert not fit.supported(3 * i).all()
    exact = np.stack([PSI + L_D * i[:, 0], L_Q * i[:, 1]])
    gap = np.abs(fit.flux_map(*i.T) - exact)
    assert gap.max() < 0.02 * PSI
    assert np.mean(NORMAL_95 * fit.learned_deviation(i) > gap.T) > 0.9
    assert min(fit.stationary.covered.values()) > 0.85
    origins = {row.source: row.origin for row in fit.parameters["R"].budget}
    assert origins["gain of the currents"] == "assumed"
    assert origins["noise of the points"] == ""
    assert fit.provenance["friction_torque"].startswith(("0.7", "0.8", "0.9"))


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("i_d", "i_q"), "i_d and i_q must differ from 0 at some point, got 0 at all of 40; check"),
        (("u_d", "u_q"), "u_d and u_q must differ from 0"),
        (("omega_el",), "omega_el must differ from 0"),
        (("torque",), "torque must differ from 0 at some point, got 0 at all of 40; remove the"),
    ],
)
def test_what_is_zero_at_all_points_is_refused(names, words):
    nothing = dict.fromkeys(names, np.zeros(40))
    points = Experiment("points.csv", 1.0, measured().channels | nothing)
    with pytest.raises(InputError, match=words):
        identify_points(points, STUDY)


def test_the_inverter_is_left_out_or_asked_for_as_the_study_says(fit):
    without = identify_points(measured(), Study(pole_pairs=PAIRS, candidates=()))
    assert "inverter_voltage" not in without.parameters
    assert without.parameters["R"].value > R + 3 * fit.parameters["R"].std
    asked = identify_points(measured(), Study(pole_pairs=PAIRS, terms=(DeadTime(),), candidates=()))
    assert asked.parameters == fit.parameters


@pytest.mark.parametrize(("pairs", "sign"), [(PAIRS + 1, 1.0), (PAIRS - 1, 1.0), (PAIRS, -1.0)])
def test_a_torque_that_is_not_the_map_s_is_named_with_the_pole_pairs_that_fit(pairs, sign):
    points = measured()
    turned = points.channels | {"torque": sign * points.channels["torque"]}
    points = Experiment("points.csv", 1.0, turned)
    choice = identify_points(points, Study(pole_pairs=pairs)).horizon
    assert choice.verdict == IMPLAUSIBLE
    (objection,) = choice.objections
    assert objection.name == "torque"
    assert f"is {sign * PAIRS / pairs:.1g}" in objection.reason
    assert f"({PAIRS} would fit)" in objection.repair


def test_the_torque_makes_the_answer_surer_where_the_voltages_are_late():
    late = {"late": 40e-6, "count": 30}
    with_torque = identify_points(measured(**late), STUDY).parameters["R"]
    without = identify_points(measured(**late, torque=False), STUDY).parameters["R"]
    assert with_torque.std < without.std
    for one in (with_torque, without):
        assert abs(one.value - R) < NORMAL_95 * one.std


def test_a_resistance_below_zero_is_no_answer():
    found = identify_points(measured(resistance=-R), STUDY)
    assert found.horizon.verdict == IMPLAUSIBLE
    assert "below zero" in found.horizon.reason


def test_points_that_leave_resistance_open_say_so():
    found = identify_points(measured(count=12, noise=1.0, torque=False, resistance=0.002), STUDY)
    assert not found.horizon.answered
    assert "may be zero" in found.horizon.reason


def test_an_exact_bench_is_surer_than_an_ordinary_one(fit):
    exact = identify_points(measured(), Study(pole_pairs=PAIRS, accuracy=Accuracy.exact()))
    assert exact.parameters["R"].std < fit.parameters["R"].std


def test_a_prediction_without_a_point_is_that_of_the_others():
    """Ridge regression with one equation left out, solved anew."""
    random = np.random.default_rng(1)
    matrix, target, deviation = random.normal(size=(9, 4)), random.normal(size=9), np.full(9, 0.3)
    prior = np.diag([0.0, 1.0, 2.0, 3.0])

    def solved(rows):
        weighed = matrix[rows] / deviation[rows, None]
        covariance = np.linalg.inv(weighed.T @ weighed + prior)
        mean = covariance @ weighed.T @ (target[rows] / deviation[rows])
        return PointsSolution(mean, covariance, np.ones(1), 0.0)

    every = np.arange(9)
    expected, spread = left_out(matrix, target, solved(every), deviation)
    for k in every:
        other = solved(every != k)
        assert expected[k] == pytest.approx(matrix[k] @ other.mean, rel=1e-9)
        own = deviation[k] ** 2 + matrix[k] @ other.covariance @ matrix[k]
        assert spread[k] == pytest.approx(np.sqrt(own), rel=1e-9)


def test_contributions_add_up_to_the_variance():
    random = np.random.default_rng(2)
    covariance = np.cov(random.normal(size=(5, 30)))
    parts, rest = contributions(covariance, 0, [2, 4])
    assert np.sum(parts**2) + rest**2 == pytest.approx(covariance[0, 0], rel=1e-9)


def test_a_mixture_has_the_spread_of_what_it_mixes():
    one = PointsSolution(np.array([1.0]), np.eye(1), np.ones(1), 0.0)
    other = PointsSolution(np.array([3.0]), np.eye(1), np.ones(1), 0.0)
    both = mixed([one, other])
    assert both.mean == pytest.approx(2.0)
    assert both.covariance == pytest.approx(2.0)
    unlikely = PointsSolution(np.array([9.0]), np.eye(1), np.ones(1), 200.0)
    assert mixed([one, unlikely]).mean == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("points", "study", "sentence"),
    [
        (measured(), Study(), "pole_pairs is missing"),
        (
            measured(torque=False),
            Study(terms=(TemperatureResistance(),)),
            "no column winding_temperature",
        ),
    ],
)
def test_what_cannot_be_used_is_refused(points, study, sentence):
    with pytest.raises(InputError, match=sentence):
        identify_points(points, study)


def test_what_magnets_lose_a_kelvin_is_in_voltages_and_torque():
    """Points at two temperatures; with the torque's part left out the torque would contradict."""
    points, coefficient = measured(count=40), -6e-5
    warm = np.where(np.arange(40) % 4 < 2, 20.0, 100.0)
    more = coefficient * (warm - 20.0)
    channels = {**points.channels, "magnet_temperature": warm}
    channels["u_q"] = channels["u_q"] + channels["omega_el"] * more
    channels["torque"] = channels["torque"] + 1.5 * PAIRS * more * channels["i_q"]
    study = Study(pole_pairs=PAIRS, terms=(MagnetTemperature(),))
    fit = identify_points(Experiment("points.csv", 1.0, channels), study)
    found = fit.parameters["magnet_coefficient"]
    assert abs(found.value - coefficient) < NORMAL_95 * found.std
    assert found.std < 0.1 * abs(coefficient)
    assert min(fit.stationary.covered.values()) > 0.85
