"""PMSM-ID: the plan, the logs of the plant in C, the answers and the scorer."""

import json
from itertools import product

import numpy as np
import pytest
from validate.pmsm_id import answer
from validate.pmsm_id.of_bench import plant
from validate.pmsm_id.score import scored, table
from validate.pmsm_id.simulated import save, write
from validate.pmsm_id.tasks import DRAWS, KINDS, MACHINES, REFUSE, tasks


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a clean log and one whose speed has the wrong sign, and what is known."""
    folder = tmp_path_factory.mktemp("pmsm_id")
    chosen = [one for one in tasks() if one.machine == "drawn 1" and one.kind in ("clean", REFUSE)][
        :2
    ]
    entries = list(write(((one, plant(one)) for one in chosen), folder))
    save([told for told, _ in entries], folder / "tasks.json")
    save([known for _, known in entries], folder / "truth.json")
    return folder


def test_twelve_machines_by_six_imperfections_by_two_draws():
    every = tasks()
    machines = [(s, m) for s, names in MACHINES.items() for m in names]
    assert (len(MACHINES), len(machines), len(KINDS), DRAWS) == (3, 12, 6, 2)
    wanted = set(product(machines, KINDS, range(DRAWS)))
    assert {((one.simulator, one.machine), one.kind, one.draw) for one in every} == wanted
    assert [one.number for one in every] == list(range(144))


def test_operating_points_are_in_pairs_of_opposite_torque():
    reference = tasks()[3].reference(100.0, 50.0)
    for first, second in ((0.01, 0.11), (0.21, 0.31), (1.21, 1.31)):
        assert reference(first) == np.conj(reference(second))
    assert max(abs(reference(t)) for t in np.linspace(0, 2.19, 500)) < 100.0


def test_what_is_told_hides_the_truth(folder):
    told, known = (json.loads((folder / f"{n}.json").read_text()) for n in ("tasks", "truth"))
    for asked, truth in zip(told, known, strict=True):
        assert set(asked) == {"log", "file", "pole_pairs", "name_plate", "currents"}
        assert 1e-3 < abs(asked["name_plate"]["R"] / truth["R"] - 1) < 0.2
        assert len(asked["currents"]["i_d"]) == len(truth["psi_q"]) == 60
    clean, wrong = (np.genfromtxt(folder / one["file"], delimiter=",", names=True) for one in told)
    for log, sign in ((clean, 1), (wrong, -1)):
        turning = np.sign(np.diff(np.unwrap(log["theta_el"])))
        assert np.all(turning == sign * np.sign(log["omega_el"][1:]))


@pytest.mark.slow
def test_a_method_answers_once_and_least_squares_find_a_clean_log(folder, capsys):
    for _ in range(2):
        answer.answer("weak least squares", folder=folder)
    assert len(capsys.readouterr().out.splitlines()) == 2
    given = answer.answers_of("weak least squares", folder)
    truths = {one["log"]: one for one in json.loads((folder / "truth.json").read_text())}
    clean, wrong = (scored(one, truths[number]) for number, one in sorted(given.items()))
    assert abs(clean.error) < 2e-3
    assert clean.map_error < 3e-3
    assert clean.useful
    assert not wrong.useful


def test_the_scorer_counts_what_is_right_wrong_and_refused():
    truth = {"kind": "clean", "R": 2.0, "psi_d": [1.0, 0.0], "psi_q": [0.0, 1.0]}
    right = {"R": 2.02, "low": 1.9, "high": 2.1, "psi_d": [1.0, 0.0], "psi_q": [0.0, 1.0]}
    good = scored(right | {"seconds": 1.0}, truth)
    assert good.error == pytest.approx(0.01)
    assert (good.map_error, good.covered, good.useful) == (0.0, True, True)
    for change in ({"R": 2.2}, {"psi_d": [1.1, 0.1]}):
        assert not scored(right | change | {"seconds": 1.0}, truth).useful
    sure = scored(right | {"high": 1.95, "seconds": 1.0}, truth)
    assert sure.covered is False
    silent = scored({"refused": "why", "seconds": 3.0}, truth | {"kind": REFUSE})
    unsure = scored({"psi_d": [1.0, 0.0], "psi_q": [0.0, 1.0], "seconds": 2.0}, truth)
    assert unsure.covered is None
    assert unsure.useful
    rows = table({"mine": [good, sure, silent, unsure]})
    assert rows[2] == "| mine | 3 of 3 | 3 | 1 | 0 | 1 of 2 | 1 of 1 | 1.5 |"
