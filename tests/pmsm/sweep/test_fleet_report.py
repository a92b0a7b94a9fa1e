"""The report of a fleet, from tables whose answers are known."""

from datetime import date, timedelta

import numpy as np
import polars as pl
import pytest

from penode.pmsm.sweep.fleet_report import fleet_report
from penode.pmsm.sweep.table import _TYPES
from penode.pmsm.sweep.trend import trend_of


def test_the_line_is_that_of_numpy():
    random = np.random.default_rng(1)
    dates = [date(2026, 1, 1) + timedelta(days=int(d)) for d in random.integers(0, 900, 30)]
    years = np.array([d.toordinal() / 365.25 for d in dates])
    values = 0.01 + 2e-4 * years + 1e-4 * random.normal(size=30)
    trend = trend_of(dates, values)
    slope, covariance = np.polyfit(years - years.mean(), values, 1, cov=True)
    assert trend.per_year == pytest.approx(slope[0], rel=1e-9)
    assert trend.half_95 == pytest.approx(2.0484 * np.sqrt(covariance[0, 0]), rel=1e-4)


def test_one_of_a_hundred_machines_without_drift_is_said_to_have_one():
    random = np.random.default_rng(2)
    dates = [date(2026, month, 1) for month in range(1, 13)]
    said = [trend_of(dates, random.normal(size=12)).significant for _ in range(2000)]
    assert 0.005 < np.mean(said) < 0.016


@pytest.mark.parametrize(
    "days", [[], [1, 2], [1, 1, 2, 2], [1, 2, 3]], ids=["none", "two", "two dates", "three"]
)
def test_too_few_dates_have_no_drift(days):
    dates = [date(2026, 1, day) for day in days]
    assert trend_of(dates, np.ones(len(days))) is None


def row(machine="M1", month=1, **other):
    plain = dict.fromkeys(_TYPES)
    named = {"key": "k", "recording": f"{machine}-{month}.csv", "machine": machine}
    said = {"verdict": "plateau", "answered": True, "objections": "", "selected": 18}
    numbers = {"R": 0.01, "R_low": 0.0099, "R_high": 0.0101, "psi_d": 0.05, "psi_d_std": 1e-4}
    times = {"seconds": 2.0, "processor_seconds": 1.0, "seed": 0, "variant": "", "status": "done"}
    when = {"date": None if month is None else f"2026-{month:02d}-01"}
    return {**plain, **named, **said, **numbers, **times, **when, **other}


def page(*rows):
    return fleet_report(pl.DataFrame(rows, _TYPES))


def test_what_drifts_is_named_and_what_does_not_is_not():
    random = np.random.default_rng(3)
    rows = [
        row(machine, month, R=0.01 * (1 + 1e-4 * random.normal() + slope * month))
        for machine, slope in (("steady", 0.0), ("ageing", 0.002))
        for month in range(1, 13)
    ]
    text = page(*rows)
    assert "24 of 24 recordings answered, 1 machine of 2 drifting" in text
    assert "does not explain the change over dates: ageing." in text
    assert "R drifts in 1 of 2 machines" in text
    assert "psi_d drifts in none of 2 machines" in text
    assert '<span class="mark">drifts</span> ageing' in text


def test_what_has_no_answer_is_counted_and_said_why():
    refused = row(status="refused", error="No <t>.", **dict.fromkeys(("R", "verdict", "answered")))
    said = {"verdict": "implausible", "objections": "outliers; free run", "reason": "Why."}
    doubted = row(month=2, answered=False, **said)
    text = page(refused, doubted, row(month=3))
    assert "1 of 3 recordings answered" in text
    assert "2 of 3 give no answer that may be used" in text
    for words in ("No &lt;t&gt;.", "Why.", "outliers", "free run", "implausible", "refused"):
        assert words in text


def test_variants_and_horizons_are_compared_and_machines_by_one_of_them():
    rows = [
        row(variant=variant, horizon=h, selected=h, R=0.01 + 1e-4 * h)
        for variant in ("plain", "network")
        for h in (1, 10)
    ]
    text = page(*rows)
    assert "by the variant plain, H = 10 and seed 0" in text
    assert "R of every identification over its horizon" in text
    assert "1 of 1 recording answered" in text


@pytest.mark.parametrize(
    "rows",
    [
        (),
        (row(machine=None, month=None),),
        (row(status="failed", error="No.", **dict.fromkeys(("R", "psi_d", "answered"))),),
    ],
    ids=["empty", "without names", "all failed"],
)
def test_whatever_the_table_holds_there_is_a_page(rows):
    assert page(*rows).startswith("<!DOCTYPE html>")


def test_a_large_fleet_is_a_page_of_bounded_size():
    rows = [row(f"M{k % 300}", 1 + k % 12, R=0.01 + 1e-6 * (k % 7)) for k in range(6000)]
    for number, one in enumerate(rows):
        one["recording"] = f"{number}.csv"
    assert len(page(*rows)) - len(page(rows[0])) < 2_000_000
