"""How sure R will be, as the check says it before training."""

from dataclasses import replace

import numpy as np
import pytest

from penode.pmsm import Accuracy, Study, check_recordings
from penode.report.uncertainty_budget import budget_sentence
from penode.validation.metrics import NORMAL_95


def expected(run, accuracy):
    return check_recordings([run], replace(Study(), accuracy=accuracy)).expected


def test_gains_move_r_in_proportion(slow_run):
    found = expected(slow_run, Accuracy(voltage_gain=0.02, current_gain=0.01))
    rows = {row.source: row.std / found.value for row in found.budget}
    assert rows["gain of the voltages"] == pytest.approx(0.02, rel=1e-3)
    assert rows["gain of the currents"] == pytest.approx(0.01, rel=1e-2)
    assert "gain of the voltages" in budget_sentence(found)


def test_what_the_sensors_do_and_what_the_balance_shows_are_apart(slow_run):
    check = check_recordings([slow_run])
    sensors, balance = check.half_widths
    assert sensors == pytest.approx(NORMAL_95 * np.hypot(0.005, 0.005), rel=0.02)
    assert np.hypot(sensors, balance) == pytest.approx(
        NORMAL_95 * check.expected.std / check.expected.value
    )


def test_with_exact_sensors_what_the_data_show_is_left(slow_run):
    check = check_recordings([slow_run], replace(Study(), accuracy=Accuracy.exact()))
    found = check.expected
    assert {row.origin for row in found.budget} <= {"", "estimated"}
    assert 0 < found.std < 0.003 * found.value
    assert check.half_widths == pytest.approx((0.0, NORMAL_95 * found.std / found.value))
    assert found.interval_95[0] < found.value < found.interval_95[1]


def test_a_broken_convention_has_none(slow_run):
    turned = replace(slow_run, channels={**slow_run.channels, "i_q": -slow_run.channels["i_q"]})
    found = check_recordings([turned])
    assert found.expected is None
    assert np.isinf(found.half_widths).all()
