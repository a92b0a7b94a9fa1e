"""Laws of the drawn physics: model and plant are one equation, the simulator is exact."""

import json
import signal
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete
from validate.ledger import Record
from validate.physics import outcome, table
from validate.physics.kind import Kind, draw
from validate.physics.kinds import KINDS, MISFITTING, WELL
from validate.physics.misfits import Misfit
from validate.physics.signals import ramps, sines, steps
from validate.physics.simulate import simulate

from penode.arrays import float64
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from validate import drawn_physics

FIRST_ORDER = Kind(
    "first_order",
    lambda m, x, u: (m.gain * u["u"] - m.rate * x[0],),
    lambda x, u, p: (p["gain"] * u[0] - p["rate"] * x[0],),
    {"y": "V"}, {"y": (0, 1)}, {"u": steps(-1, 1, 10)},
    {"gain": ("1/s", 1, 2), "rate": ("1/s", 1, 2)},
    step=0.05, samples=120,
)  # fmt: skip


def test_forty_kinds_of_two_to_six_states():
    assert (len(WELL), len(MISFITTING), len(KINDS)) == (24, 16, 40)
    assert {len(kind.states) for kind in WELL} == {2, 3, 4, 6}
    assert not any(kind.misfits for kind in WELL)
    assert all(kind.misfits for kind in MISFITTING)
    assert sum(len(kind.measured) < len(kind.states) for kind in WELL) > 10


@pytest.mark.parametrize("kind", {kind.rates: kind for kind in WELL}.values(), ids=lambda k: k.name)
def test_model_and_plant_are_one_equation(kind):
    random = np.random.default_rng(3)
    truth = {name: np.sqrt(low * high) for name, (_, low, high) in kind.parameters.items()}
    inputs = [signal(random, 50).piece(7)(7) for signal in kind.inputs.values()]
    for _ in range(3):
        x = np.array([random.uniform(*ends) for ends in kind.first.values()])
        x += random.uniform(0.0, 0.3, len(x))
        with float64():
            drive = Inputs(jnp.array(inputs).reshape(-1, 1), tuple(kind.inputs))
            batched = with_batch_axis(kind.model(**truth))
            rates = np.asarray(batched.derivative(jnp.array(x)[:, None], drive))[:, 0]
        np.testing.assert_allclose(rates, kind.plant(x.tolist(), inputs, truth), rtol=1e-9)


@pytest.mark.parametrize(("hold", "signal"), [("zoh", steps(-9, 9, 7)), ("foh", ramps(-9, 9, 7))])
def test_the_simulator_is_exact_on_a_linear_plant(hold, signal):
    """Discretised by the matrix exponential, whose states come from the outputs of the hold."""
    kind = KINDS["rlc_ladder"]
    truth = {name: low for name, (_, low, _) in kind.parameters.items()}
    path = signal(np.random.default_rng(4), 60)
    run = simulate(kind.plant, truth, [0.0] * 4, [path], kind.step, 60)
    A = np.stack([kind.plant(row, [0.0], truth) for row in np.eye(4).tolist()], axis=1)
    B = np.array([kind.plant([0.0] * 4, [1.0], truth)]).T
    a, b, c, d, _ = cont2discrete((A, B, np.eye(4), np.zeros((4, 1))), kind.step, hold)
    u = path.sampled(60)
    state = -np.linalg.solve(c, d)[:, 0] * u[0]
    exact = np.empty((60, 4))
    for k in range(60):
        exact[k], state = c @ state + d[:, 0] * u[k], a @ state + b[:, 0] * u[k]
    np.testing.assert_allclose(run, exact, atol=1e-6 * np.abs(exact).max())


def test_inputs_are_late_or_cut_off():
    for drawn in (steps(0, 5, 6), ramps(0, 5, 6), sines(2, 3, 5, 20)):
        path = drawn(np.random.default_rng(5), 40)
        values = path.sampled(40)
        np.testing.assert_allclose(path.late(2).sampled(40)[2:], values[:-2], rtol=1e-12)
        np.testing.assert_array_equal(path.within(1, 3).sampled(40), np.clip(values, 1, 3))


@pytest.mark.parametrize("kind", MISFITTING, ids=lambda kind: kind.name)
def test_a_misfit_is_more_than_noise_and_less_than_the_whole(kind):
    few = kind.variant(kind.name, samples=300)
    bare = few.variant(kind.name, misfit=Misfit())
    more, less = draw(few, 0), draw(bare, 0)
    assert more.truth == less.truth
    gap = np.abs(more.train.states - less.train.states) / less.train.states.std(axis=0)
    assert gap.max() > 0.01
    assert np.sqrt(np.mean(gap**2)) < 1.0


def test_a_plant_that_runs_away_ends():
    path = steps(0, 1, 3)(np.random.default_rng(6), 30)
    run = simulate(lambda x, u, p: [x[0] ** 2], {}, [1.0], [path], 0.1, 30)
    assert np.isfinite(run[: int(path.breaks[0])]).all()
    assert np.isnan(run[-1]).all()


def _record(**other: object) -> Record:
    rungs = [{"horizon": h, "error": e, "fresh": 1.0} for h, e in ((1, 0.2), (8, 0.1), (64, 0.4))]
    one = {
        "draw": "x 0", "physics": "x", "number": 0, "misfits": False, "truth": {"a": 1.0, "b": 2.0},
        "values": {"a": 1.1, "b": 2.0}, "half": {"a": 0.2, "b": None}, "verdict": "plateau",
        "positive": True, "reason": "", "objections": [], "selected": 8, "error": 0.15,
        "fresh": 1.0, "rungs": rungs, "seconds": 3.0, "compiled": 5,
        "warned": [],
    }  # fmt: skip
    return one | other


def test_right_is_within_an_interval_or_within_two_per_cent():
    assert outcome.is_right(_record())
    assert not outcome.is_right(_record(half={"a": 0.05, "b": None}))
    assert not outcome.is_right(_record(half={"a": None, "b": None}))
    assert outcome.is_right(_record(values={"a": 1.015, "b": 2.0}, half={"a": None, "b": None}))
    assert not outcome.is_right(_record(fresh=1.3))
    assert not outcome.is_right(_record(fresh=None))


def test_table(capsys):
    wrong = _record(values={"a": 1.3, "b": 2.0}, number=8, error=0.3, seconds=1.0)
    doubted = _record(verdict="implausible", positive=False, objections=["dependent residual"])
    doubted |= {"number": 7}
    failed = drawn_physics._killed("pendulum", 0, "gone")
    table.print_table([_record(number=7), wrong, doubted, failed])
    printed = capsys.readouterr().out
    line = next(line for line in printed.splitlines() if line.startswith("x ")).split()
    assert line[1:8] == ["2/", "3", "1/", "2", "50", "%", "2"]
    assert line[-3:] == ["3", "1", "5"]  # seconds of the first draws and of the other, programs
    assert "2/  4" in next(line for line in printed.splitlines() if line.startswith("ALL"))
    assert "right, but implausible: dependent residual: 1 (x)" in printed
    assert "0/  1" in next(line for line in printed.splitlines() if line.startswith("pendulum"))
    assert "b +0 ± inf*" in table.line_of(_record())
    assert "gone" in table.line_of(failed)


def test_what_is_kept_is_not_done_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    drawn_physics.keep(drawn_physics._killed("pendulum", 0, "gone"))
    drawn_physics.main(["1", "0", "pendulum", "--jobs", "1"])
    assert capsys.readouterr().out.count("gone") == 1
    with pytest.raises(SystemExit):
        drawn_physics.main(["1", "0", "no_such_kind"])
    assert "no kind no_such_kind" in capsys.readouterr().err


@pytest.mark.parametrize(("status", "kept"), [(-signal.SIGTERM, 0), (-signal.SIGKILL, 1)])
def test_a_process_that_ends_by_itself_is_a_result_and_one_that_is_ended_is_none(
    status, kept, tmp_path, monkeypatch
):
    """SIGTERM is a person's, SIGKILL the system's where memory runs out."""
    monkeypatch.chdir(tmp_path)
    ended = SimpleNamespace(start=lambda: None, join=lambda: None, exitcode=status)
    context = SimpleNamespace(Process=lambda target, args: ended)
    monkeypatch.setattr(drawn_physics, "get_context", lambda _: context)
    drawn_physics._run_kind([0], "pendulum")
    assert len(drawn_physics.known()) == kept


@pytest.mark.slow
def test_a_draw_is_identified_and_the_next_compiles_nothing():
    first, second = (outcome.result_of(FIRST_ORDER, number) for number in (0, 1))
    for record in (first, second):
        assert record["fresh"] == pytest.approx(1.0, abs=0.1)
        assert record["error"] < 0.1
        assert len(record["rungs"]) > 2
        json.dumps(record, allow_nan=False)
    assert first["compiled"] > 0
    assert second["compiled"] == 0
