"""The torque of the shaft in a recording: what it narrows, what else it is made of, refusals."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from tests.pmsm.points.test_beside import believed
from tests.pmsm.points.test_operating_points import L_D, L_Q, PAIRS, PSI, STUDY, R, measured

from penode import Experiment, InputError
from penode.arrays import float64
from penode.data.experiment import Source
from penode.data.mapping import Origin
from penode.data.table import Signal, table_of
from penode.fit.fit import Estimate, HorizonChoice
from penode.fit.learned_uncertainty import map_slopes
from penode.models.layout import Layout
from penode.pmsm import load_study
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.pmsm.points.beside import _Update, with_recorded_torque
from penode.pmsm.points.identify import identify_points
from penode.pmsm.points.recorded_torque import TorqueBalance
from penode.pmsm.recording.drive_mapping import DriveMapping, DriveOrigin

STEP, DRAG, VISCOUS, INERTIA = 1e-3, 0.8, 0.02, 0.3
AT = np.array([[-60.0, 90.0], [-20.0, -120.0]])


def recording(seconds=2.0, torque=1.0, noise=0.2, accelerating=True):
    """Return a recording of a linear machine, with the torque of its shaft times a factor."""
    t, random = STEP * np.arange(round(seconds / STEP)), np.random.default_rng(4)
    i = -60.0 + 50 * np.cos(9.0 * t) + 100j * np.sin(7.0 * t)
    speed = 600.0 + 200 * np.sin(3.0 * t) * accelerating
    psi = PSI + L_D * i.real + 1j * L_Q * i.imag
    shaft = 1.5 * PAIRS * np.imag(np.conj(psi) * i) - DRAG
    shaft -= (VISCOUS * speed + INERTIA * 600 * np.cos(3.0 * t) * accelerating) / PAIRS
    measured = torque * (shaft + noise * random.normal(size=len(t)))
    names = "i_d", "i_q", "u_d", "u_q", "omega_el", "torque"
    values = i.real, i.imag, np.ones(len(t)), np.ones(len(t)), speed, measured
    return Experiment("run.csv", STEP, dict(zip(names, values, strict=True)))


@pytest.fixture(scope="module")
def fit():
    """Return what a recording might have shown, the map 0.6 % too large by its voltages' gain."""
    points = measured(count=60, seed=5)
    alone = identify_points(points, STUDY)
    model = Machine(alone.model.flux, (Resistance(R),))
    layout = Layout(model)
    slopes = map_slopes(model, points.stack(("i_d", "i_q"))).reshape(-1, layout.size)
    precision = slopes.T @ slopes / 1e-4**2 + 1e3 * np.eye(layout.size)
    at = layout.physical_members
    precision[at, at] = (0.004 * R) ** -2
    raw = np.where(layout.members(("learned",)), 1.006, 1.0) * layout.raw(model)
    with float64():
        model = layout.plain_model(raw)
    fit = replace(
        alone,
        model=model,
        parameters={"R": Estimate.of(R, 0.004 * R, "ohm", 0.9)},
        horizon=HorizonChoice(50, "plateau", "Horizons agree.", ()),
        stationary=None,
    )
    return believed(fit, np.linalg.inv(precision))


def true(at):
    return np.stack([PSI + L_D * at[:, 0], L_Q * at[:, 1]])


def test_it_narrows_the_map_and_says_so(fit):
    found = with_recorded_torque(fit, [recording()], PAIRS, STUDY.accuracy)
    assert (
        "run.csv: the torque of the shaft narrows the map, 100 means"
        in found.provenance["structure"][-1]
    )
    before, after = (np.abs(one.flux_map(*AT.T) - true(AT)).max() for one in (fit, found))
    assert after < before
    assert (found.learned_deviation(AT).max(axis=0) < fit.learned_deviation(AT).max(axis=0)).all()
    assert found.parameters["R"].std <= 1.001 * fit.parameters["R"].std
    assert sum(row.std**2 for row in found.parameters["R"].budget) == pytest.approx(
        found.parameters["R"].std ** 2, rel=1e-6
    )
    assert found.stationary.covered["torque"] > 0.85
    one = found.stationary
    left, without = one.measured - one.fitted, one.measured - one.without
    assert (np.sign(left) == np.sign(without)).all()
    assert (np.abs(left) < np.abs(without)).all()
    assert found.horizon == fit.horizon
    assert found.stationary.name == "the torque in run.csv"


def test_friction_and_inertia_are_not_taken_for_the_map(fit):
    """A sensor whose gain is known shows the map's scale, whatever else the shaft's torque is."""
    exact = type(STUDY.accuracy)(torque_gain=0.0, current_gain=0.0)
    for accelerating in (True, False):
        run = recording(noise=0.0, accelerating=accelerating)
        found = with_recorded_torque(fit, [run], PAIRS, exact)
        np.testing.assert_allclose(found.flux_map(*AT.T), true(AT), rtol=2e-3, atol=1e-4)


def test_it_is_least_squares_of_the_recording_and_the_torque_together(fit):
    one = _Update(fit, fit.model, balance(fit))
    of_model, of_gains, own = one.matrix
    expected = of_model @ (one.belief + one.moved @ one.moved.T) @ of_model.T
    crossed = of_model @ one.moved @ of_gains.T
    expected += own @ own.T + of_gains @ of_gains.T - crossed - crossed.T + np.diag(one.noise**2)
    np.testing.assert_allclose(one.gain[1], expected, rtol=1e-9, atol=1e-9 * expected.max())


def balance(fit):
    return TorqueBalance("run.csv", [recording()], PAIRS, STUDY.accuracy, fit.model)


def test_columns_are_the_derivatives_of_what_is_left(fit):
    """Of the map by differences, of a gain of the currents by the recording that it changes."""
    one, layout = balance(fit), Layout(fit.model)
    rows = one.rows(lambda at: map_slopes(fit.model, at))
    raw, step = layout.raw(fit.model), np.random.default_rng(1).normal(size=layout.size)
    step *= 1e-3 * layout.members(("learned",))
    with float64():
        maps = [layout.plain_model(raw + sign * step).maps()["flux_map"] for sign in (1, -1)]
    left = [one.left(lambda at, own=own: np.asarray(own(*at.T)).T, {}) for own in maps]
    np.testing.assert_allclose(rows[:, -layout.size :] @ step, (left[1] - left[0]) / 2, atol=1e-9)
    size = one.imperfections["current_gain"][1]
    run = one.recordings[0]
    larger = {n: (1 + size) * run.channels[n] for n in ("i_d", "i_q")}
    other = replace(one, recordings=[replace(run, channels={**run.channels, **larger})])
    gap = one.left(one._flux, {}) - other.left(one._flux, {})
    column = rows[:, one.names.index("current_gain")]
    np.testing.assert_allclose(column, gap, atol=1e-9)


@pytest.mark.parametrize(
    ("run", "pairs", "said"),
    [
        (recording(torque=-1.0), PAIRS, "times as far from what the recordings say"),
        (
            recording(torque=1.25),
            PAIRS,
            "Check the pole pairs (5 would fit), and sign and unit of the torque.",
        ),
        (recording(), None, "pole_pairs is missing; add it."),
        (recording(seconds=0.1), PAIRS, "it lasts less than 0.16 s."),
    ],
)
def test_a_torque_that_is_none_of_this_machine_is_left_out_with_a_reason(fit, run, pairs, said):
    found = with_recorded_torque(fit, [run], pairs, STUDY.accuracy)
    assert found.model is fit.model
    assert found.horizon == fit.horizon
    assert said in found.warnings[-1]


def test_a_recording_without_a_torque_stays(fit):
    run = recording()
    silent = {name: values for name, values in run.channels.items() if name != "torque"}
    for channels in (silent, {**silent, "torque": np.zeros(len(run))}):
        same = with_recorded_torque(fit, [replace(run, channels=channels)], PAIRS, STUDY.accuracy)
        assert same is fit


def test_the_column_is_read_where_a_file_has_it(tmp_path):
    run, file, study = recording(), tmp_path / "run.csv", tmp_path / "study.toml"
    names = list(run.channels)
    rows = np.column_stack([STEP * np.arange(len(run)), run.stack(names)])
    np.savetxt(file, rows, "%.9g", ",", header=",".join(["t", *names]), comments="")
    np.testing.assert_allclose(
        load_study(None).load(file).channels["torque"], run.channels["torque"], rtol=1e-6
    )
    mapped = "\n".join(f'{name} = "{name}"' for name in ["t", *names] if name != "torque")
    study.write_text(f'[channels]\n{mapped}\ntorque = {{ column = "missing", unit = "mNm" }}\n')
    assert "torque" not in load_study(study).load(file).channels
    study.write_text(f'[channels]\n{mapped}\ntorque = {{ column = "torque", unit = "mNm" }}\n')
    found = load_study(study).load(file).channels["torque"]
    np.testing.assert_allclose(found, 1e-3 * run.channels["torque"], rtol=1e-6)


def test_a_torque_of_another_clock_is_read_only_where_it_is_asked_for():
    run, source = recording(), Source("run.mf4", "0")
    units = {"i_d": "A", "i_q": "A", "u_d": "V", "u_q": "V", "omega_el": "rad/s", "torque": "Nm"}
    signals = []
    for name, unit in units.items():
        values = run.channels[name][:: 10 if name == "torque" else 1]
        t = STEP * (10 if name == "torque" else 1) * np.arange(len(values))
        signals.append(Signal(name, name, unit, partial(np.asarray, values), t))
    table = table_of("run.mf4", signals)
    (plain,) = DriveMapping().stretches_of("run.mf4", table, source)
    assert "torque" not in plain.channels
    mapped = {n: DriveOrigin(Origin(n, unit)) for n, unit in units.items()}
    (both,) = DriveMapping(mapped, resample=True).stretches_of("run.mf4", table, source)
    assert "torque" in both.channels
    with pytest.raises(InputError, match="resample"):
        DriveMapping(mapped).stretches_of("run.mf4", table, source)
