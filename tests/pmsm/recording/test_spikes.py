"""Spikes of currents and voltages: left out and named; what belongs to a drive stays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from penode import Experiment
from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.stretches import reasons_of
from penode.pmsm.balance.usable import usable_stretches
from penode.pmsm.recording import spikes
from penode.pmsm.recording.spikes import without_spikes
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

COUNT = 3000
TIME = np.arange(COUNT)


def recording(**channels):
    """Return a drive's recording with some channels replaced."""
    noise = np.random.default_rng(0).normal(size=(4, COUNT))
    currents = {"i_d": 100.0 * np.sin(TIME / 50.0), "i_q": 100.0 * np.cos(TIME / 50.0)}
    voltages = {"u_d": 20.0 * np.cos(TIME / 50.0), "u_q": 20.0 * np.sin(TIME / 50.0)}
    plain = {**currents, **voltages, "omega_el": np.full(COUNT, 300.0)}
    noisy = {name: plain[name] + 0.3 * n for name, n in zip(plain, noise, strict=False)}
    return Experiment("run.csv", 1e-4, {**plain, **noisy, **channels})


def with_samples(run, channel, samples):
    values = run.channels[channel].copy()
    for at, value in samples.items():
        values[at] += value
    return replace(run, channels={**run.channels, channel: values})


@given(
    at=st.integers(250, COUNT - 251),
    size=st.floats(60.0, 1e9),
    sign=st.sampled_from([-1.0, 1.0]),
    channel=st.sampled_from(["i_d", "i_q"]),
    piece=st.sampled_from([100, 701, 1 << 18]),
)
def test_a_spike_is_left_out_wherever_it_lies_and_named(at, size, sign, channel, piece):
    run = with_samples(recording(), channel, {at: sign * size})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spikes, "PIECE", piece)
        before, after = without_spikes([run])
    assert (len(before), after.place.row) == (at, at + 1)
    assert len(before) + len(after) == COUNT - 1
    said = (
        f"run.csv: {channel} jumps there and back within two samples, which no drive does, at "
        f"data row {at + 1}. This sample is left out."
    )
    assert reasons_of([before, after]) == (said,)


def test_several_spikes_are_one_sentence_with_what_is_too_short_between_them():
    run = with_samples(recording(), "i_d", {1000: 300.0, 1100: -200.0})
    kept = without_spikes([with_samples(run, "i_q", {2000: 1e4})])
    assert [len(e) for e in kept] == [1000, 899, 999]
    assert reasons_of(kept) == (
        "run.csv: i_d, i_q jump there and back within two samples, which no drive does, at data "
        "rows 1001, 1101, 2001. These samples are left out, with 99 beside that are fewer than 200 "
        "in a row.",
    )


def test_a_spike_in_a_stretch_is_named_by_its_row_in_the_file():
    run = with_samples(recording(), "i_q", {2500: 500.0})
    kept = without_spikes([run.between(0, 900), run.between(1000, 3000)])
    assert [(e.place.row, len(e)) for e in kept] == [(0, 900), (1000, 1500), (2501, 499)]
    assert "at data row 2501." in reasons_of(kept)[0]


def test_a_spike_of_a_voltage_is_one_that_no_link_could_have_made():
    run = recording()
    assert len(without_spikes([with_samples(run, "u_d", {1500: 1e5})])) == 2
    assert len(without_spikes([with_samples(run, "u_d", {1500: 400.0})])) == 1
    linked = replace(run, channels={**run.channels, "u_dc": np.full(COUNT, 600.0)})
    assert len(without_spikes([with_samples(linked, "u_d", {1500: 1e4})])) == 2
    assert len(without_spikes([with_samples(linked, "u_dc", {1500: 1e6})])) == 1


@pytest.mark.parametrize("still", [False, True])
def test_a_spike_of_the_speed_is_one_that_no_inertia_allows(still):
    speed = np.full(COUNT, 300.0) if still else 300.0 + 0.3 * np.sin(TIME / 9.0)
    run = recording(omega_el=speed)
    assert len(without_spikes([with_samples(run, "omega_el", {1500: -700.0})])) == 2
    assert len(without_spikes([with_samples(run, "omega_el", {1500: 200.0})])) == 1


@pytest.mark.parametrize("at", range(295, 306))
def test_no_spike_is_lost_between_pieces(at, monkeypatch):
    monkeypatch.setattr(spikes, "PIECE", 102)
    assert len(without_spikes([with_samples(recording(), "i_q", {at: 500.0})])) == 2


pulses = dict.fromkeys(range(100, COUNT, 60), 80.0)
steps = np.where(TIME // 300 % 2, 100.0, -100.0)
answers = dict.fromkeys(range(300, COUNT, 300), 500.0)


@pytest.mark.parametrize(
    "run",
    [
        pytest.param(recording(), id="plain"),
        pytest.param(recording(i_q=1e-9 * (TIME == 700)), id="rounding"),
        pytest.param(with_samples(recording(i_q=steps), "u_q", answers), id="dead-beat control"),
        pytest.param(with_samples(recording(), "i_d", pulses), id="test pulses"),
        pytest.param(with_samples(recording(), "i_d", {1000: 15.0}), id="small"),
        pytest.param(with_samples(recording(), "i_d", {1000: 500.0, 1001: 500.0}), id="pair"),
        pytest.param(
            recording(i_d=np.random.default_rng(1).standard_t(3, COUNT)), id="heavy tails"
        ),
        pytest.param(recording().part(0, 2), id="two samples"),
        pytest.param(with_samples(recording().part(0, 300), "i_d", {150: 1e6}), id="short"),
    ],
)
def test_what_belongs_to_a_drive_or_leaves_nothing_stays(run):
    assert without_spikes([run]) == [run]


@pytest.mark.slow
def test_a_recording_with_a_spike_is_identified_as_without():
    run = simulate(
        TRACTION_300A,
        Lissajous(240.0, 50.0, 43.0),
        speed_rpm=1000.0,
        duration=1.0,
        drive=Drive(current_noise=0.3),
        seed=1,
    )
    hit = with_samples(run, "i_d", {4000: 1e6})
    study = Study(candidates=(), angle_orders=())
    fit, whole = identify([hit], study=study), identify([run], study=study)
    assert fit.horizon.verdict == "plateau"
    assert fit.horizon.reason.endswith("1 of 10000 samples was left out.")
    gap = fit.parameters["R"].value - whole.parameters["R"].value
    assert abs(gap) < 0.3 * whole.parameters["R"].std


def test_each_recording_has_spikes_of_its_own():
    hit = with_samples(recording(), "i_d", {1500: 1e3})
    assert [len(e) for e in usable_stretches([recording(), hit])] == [COUNT, 1500, 1499]
