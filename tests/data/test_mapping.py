"""Mapping: what a row becomes, one clock, delays, and every refusal."""

import numpy as np
import pytest

from penode.data.experiment import Source
from penode.data.load import experiments_of
from penode.data.mapping import Origin, map_channels
from penode.data.table import Table
from penode.errors import InputError

STEP = 1e-3


def table(samples=40, **changes):
    time = np.arange(samples) * STEP
    columns = {"t": time, "x": np.sin(30 * time), "duty": np.linspace(0, 100, samples)}
    return Table({**columns, **changes}, {"x": "mA", "duty": "%"})


def mapped(origins, content=None, resample=False):
    found = map_channels("run.csv", content or table(), origins, resample)
    assert found.spans == ((0, len(found.times)),)
    return found.time_step, found.channels


def refusal(origins, content=None, resample=False):
    with pytest.raises(InputError) as caught:
        mapped(origins, content, resample)
    sentence = str(caught.value)
    assert sentence.startswith("run.csv: ")
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


# --- values -----------------------------------------------------------------------------------


def test_scale_sign_and_unit_multiply():
    _, channels = mapped({"i": Origin("x", "A", scale=2.5, sign=-1)})
    np.testing.assert_allclose(channels["i"], -2.5e-3 * table().columns["x"], rtol=1e-15)


def test_a_unit_that_is_given_wins_over_the_files():
    _, channels = mapped({"i": Origin("x", "A", "A")})
    np.testing.assert_array_equal(channels["i"], table().columns["x"])


def test_a_share_is_of_the_other_column():
    dc = np.linspace(300, 400, 40)
    _, channels = mapped({"u": Origin("duty", "V", times="dc")}, table(dc=dc))
    np.testing.assert_allclose(channels["u"], np.linspace(0, 1, 40) * dc, rtol=1e-14)


def test_a_unit_unknown_here_is_left_alone_where_no_quantity_is_asked_for():
    content = Table(table().columns, {"x": "furlong"})
    _, channels = mapped({"x": Origin("x")}, content)
    np.testing.assert_array_equal(channels["x"], content.columns["x"])


# --- delays -----------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [-3, 0, 2])
def test_a_delayed_column_is_put_back_in_time(delay):
    rows = np.arange(40.0)
    late = np.roll(rows, delay)  # row k holds what was true at row k - delay
    step, channels = mapped(
        {"late": Origin("late", delay=delay), "x": Origin("row")}, table(late=late, row=rows)
    )
    assert step == pytest.approx(STEP, rel=1e-12)
    assert len(channels["x"]) == 40 - abs(delay)
    np.testing.assert_array_equal(channels["late"], channels["x"])


@pytest.mark.parametrize("delay", [40, -50, 10**18])
def test_a_delay_longer_than_the_recording_is_refused_by_name(delay):
    sentence = refusal({"x": Origin("x", delay=delay)})
    assert f"delay must be a few samples at most, got {delay} in a recording of 40" in sentence


# --- several clocks ---------------------------------------------------------------------------


def two_rates(slow_times=None, angle=None):
    """Column fast every 1 ms, slow and angle every 10 ms."""
    fast_times = np.arange(200) * STEP
    slow_times = np.arange(20) * 10 * STEP if slow_times is None else slow_times
    columns = {
        "t": fast_times,
        "fast": np.cos(50 * fast_times),
        "t_2": slow_times,
        "slow": 3.0 + 2.0 * slow_times,
        "angle": np.mod(8.0 * slow_times, 2 * np.pi) if angle is None else angle,
    }
    clocks = {"t": "t", "fast": "t", "t_2": "t_2", "slow": "t_2", "angle": "t_2"}
    return Table(columns, {"t_2": "s"}, clocks)


ORIGINS = {"fast": Origin("fast"), "slow": Origin("slow"), "angle": Origin("angle", "rad")}


def test_resampling_is_linear_on_the_fastest_clock_over_the_common_time():
    step, channels = mapped(ORIGINS, two_rates(), resample=True)
    time = np.arange(191) * STEP  # the slow clock ends at 190 ms
    assert step == pytest.approx(STEP, rel=1e-12)
    np.testing.assert_array_equal(channels["fast"], np.cos(50 * time))
    np.testing.assert_allclose(channels["slow"], 3.0 + 2.0 * time, rtol=1e-13)


def test_an_angle_is_interpolated_without_its_jumps():
    content = two_rates(angle=np.mod(100.0 * np.arange(20) * 10 * STEP, 2 * np.pi))
    _, channels = mapped(ORIGINS, content, resample=True)
    turned = channels["angle"] - 100.0 * np.arange(191) * STEP
    np.testing.assert_allclose(np.exp(1j * turned), 1.0, atol=1e-12)


def test_resampling_changes_nothing_where_the_clocks_are_the_same():
    content = two_rates(slow_times=np.arange(200) * STEP)
    plain, resampled = mapped(ORIGINS, content), mapped(ORIGINS, content, resample=True)
    for name in ORIGINS:
        np.testing.assert_array_equal(plain[1][name], resampled[1][name])


def test_several_rates_are_refused_where_resampling_is_not_asked_for():
    sentence = refusal(ORIGINS, two_rates())
    for word in (
        "channel fast",
        "200 samples",
        "channel slow",
        "every 0.01 s",
        'resample = "linear"',
    ):
        assert word in sentence


def test_a_gap_is_not_interpolated():
    times = np.delete(np.arange(21) * 10 * STEP, 7)
    assert "gap" in refusal(ORIGINS, two_rates(slow_times=times), resample=True)


def test_an_angle_that_turns_too_far_is_not_interpolated():
    angle = np.mod(300.0 * np.arange(20) * 10 * STEP, 2 * np.pi)
    sentence = refusal(ORIGINS, two_rates(angle=angle), resample=True)
    assert "channel angle turns" in sentence


def test_a_time_column_of_ones_own_in_the_group_is_taken():
    """The group's other times are in ms, and the mapping says so."""
    content = two_rates()
    content.columns["mine"] = content.columns["t_2"] * 1e3
    content.clocks["mine"] = "t_2"
    origins = {"t": Origin("mine", "s", "ms"), "slow": Origin("slow")}
    step, _ = mapped(origins, content)
    assert step == pytest.approx(10 * STEP, rel=1e-12)


# --- jitter -------------------------------------------------------------------------------------


def jittered(samples=900, size=0.05, seed=3, lost=(0, 0)):
    """Return a table sampled at jittering times: a slow sine, an angle and a straight line."""
    rng = np.random.default_rng(seed)
    time = 7.0 + (np.arange(samples) + rng.uniform(-size, size, samples)) * STEP
    time = np.delete(time, slice(*lost))
    columns = {
        "t": time,
        "sine": np.sin(20.0 * time),
        "line": 3.0 + 2.0 * time,
        "angle": np.mod(300.0 * time, 2 * np.pi),
    }
    return Table(columns, {}), time


JITTERED = {"sine": Origin("sine"), "line": Origin("line"), "angle": Origin("angle", "rad")}


def test_jittering_times_are_refused_with_the_two_repairs():
    sentence = refusal(JITTERED, jittered()[0])
    for word in ("t jitters", 'resample = "linear"', "give its step in s as time_step"):
        assert word in sentence


def test_channels_of_jittering_times_are_taken_at_uniform_ones():
    content, time = jittered()
    step, channels = mapped(JITTERED, content, resample=True)
    uniform = time[0] + step * np.arange(len(channels["line"]))
    assert step == pytest.approx(STEP, rel=2e-4)
    assert len(uniform) in (899, 900)
    np.testing.assert_allclose(channels["line"], 3.0 + 2.0 * uniform, rtol=1e-12)
    # Linear interpolation errs by an eighth of step squared times the second derivative at most.
    np.testing.assert_allclose(channels["sine"], np.sin(20.0 * uniform), atol=400 * STEP**2 / 7)
    turned = np.exp(1j * (channels["angle"] - 300.0 * uniform))
    np.testing.assert_allclose(turned, 1.0, atol=1e-9)


def test_a_gap_among_jittering_times_stays_a_gap():
    content, time = jittered(lost=(400, 450))
    found = map_channels("run.csv", content, JITTERED, True)
    assert found.spans == ((0, 400), (400, len(found.times)))
    for first, last in found.spans:
        uniform = found.times[first] + found.time_step * np.arange(last - first)
        np.testing.assert_allclose(found.times[first:last], uniform, atol=1e-4 * STEP)
    np.testing.assert_allclose(found.channels["line"], 3.0 + 2.0 * found.times, rtol=1e-12)
    assert found.times[400] == time[400]


def test_jittering_stretches_of_two_rates_are_refused_as_such():
    content, time = jittered()
    content.columns["t"] = np.concatenate([time[:400], 9.0 + 1.2 * (time[400:] - 7.0)])
    sentence = refusal(JITTERED, content, resample=True)
    assert "export each rate to a file of its own" in sentence


def test_times_that_decrease_are_refused_also_where_resampling_is_asked_for():
    content, time = jittered()
    content.columns["t"] = np.r_[time[:400], time[400:402][::-1], time[402:]]
    assert "t decreases at data row 402" in refusal(JITTERED, content, resample=True)


def test_channels_of_several_jittering_clocks_are_taken_at_the_fastest_made_uniform():
    content = two_rates()
    rng = np.random.default_rng(5)
    for name in ("t", "t_2"):
        pace = np.diff(content.columns[name][:2])
        content.columns[name] = content.columns[name] + pace * rng.uniform(
            -0.05, 0.05, len(content.columns[name])
        )
    content.columns["slow"] = 3.0 + 2.0 * content.columns["t_2"]
    step, channels = mapped(ORIGINS, content, resample=True)
    assert step == pytest.approx(STEP, rel=1e-3)
    np.testing.assert_allclose(np.diff(channels["slow"]), 2.0 * step, rtol=1e-9)


LOST = [k for k in range(1200) if k not in (300, 301, 302, 700)]


@pytest.mark.parametrize(
    "stamped",
    [
        lambda true, random: true + STEP * random.exponential(0.15, len(true)),
        lambda true, random: true + STEP * random.uniform(-0.2, 0.2, len(true)),
        lambda true, random: np.floor(true / (4 * STEP) + 1e-9) * 4 * STEP,
    ],
    ids=["late", "early and late", "in steps of four rows"],
)
def test_stamps_of_a_steady_clock_give_its_times_and_the_rows_that_were_lost(stamped):
    true = 5.0 + STEP * np.array(LOST)
    stamps = np.maximum.accumulate(stamped(true, np.random.default_rng(4)))
    content = Table({"t": stamps, "line": true}, {})
    found = map_channels("run.csv", content, {"line": Origin("line")}, time_step=STEP)
    assert found.time_step == pytest.approx(STEP, rel=1e-9)
    assert found.spans[0] == (0, 300)
    assert found.spans[1] == (300, 697)
    for first, last in found.spans:
        np.testing.assert_allclose(np.diff(found.channels["line"][first:last]), STEP, rtol=1e-9)
    jumps = np.diff(found.times)[[299, 696]]
    np.testing.assert_allclose(jumps, [4 * STEP, 2 * STEP], rtol=1e-9)


@pytest.mark.parametrize("factor", [0.5, 0.6, 0.98, 1.02, 2.0, 3.0])
def test_a_time_step_that_the_stamps_do_not_have_is_refused(factor):
    content, _ = jittered()
    with pytest.raises(InputError, match=r"the rows of t are .* s apart; set"):
        map_channels("run.csv", content, JITTERED, time_step=factor * STEP)


def test_stamps_that_decrease_are_refused_also_where_their_clock_is_known():
    content, time = jittered()
    content.columns["t"] = np.r_[time[:400], time[400:402][::-1], time[402:]]
    with pytest.raises(InputError, match="t decreases at data row 402"):
        map_channels("run.csv", content, JITTERED, time_step=STEP)


# --- refusals ---------------------------------------------------------------------------------


def test_a_time_that_the_study_file_names_and_the_file_lacks_is_named_there():
    content, _ = jittered()
    origins = {"t": Origin("Zeit", "s"), "line": Origin("line")}
    with pytest.raises(InputError, match=r"no column Zeit .* the study file maps t to it: name"):
        experiments_of(content, Source("run.csv", ""), origins)


def test_missing_column_suggests_the_nearest():
    sentence = refusal({"u": Origin("dutty", "V")})
    for word in ("no column dutty", "channel u", "did you mean duty?", "t, x, duty"):
        assert word in sentence


def test_unit_of_another_quantity():
    sentence = refusal({"u": Origin("x", "V", "rpm")})
    for word in ("channel u", "'rpm'", "column x", "V, mV, kV"):
        assert word in sentence


def test_unit_of_the_file_of_another_quantity():
    assert "the unit of column x must be one of V, mV, kV, got 'mA'" in refusal(
        {"u": Origin("x", "V")}
    )


def test_columns_of_other_lengths():
    sentence = refusal({"x": Origin("short")}, table(short=np.zeros(7)))
    for word in ("column short has 7 values", "column t are 40"):
        assert word in sentence
    sentence = refusal({"u": Origin("duty", "V", times="dc")}, table(dc=np.ones(3)))
    for word in ("column duty has 40 values", "column dc 3 "):
        assert word in sentence


def test_a_value_that_is_not_finite_is_refused_in_used_columns_only():
    content = table(bad=np.r_[np.ones(20), np.nan, np.ones(19)])
    mapped({"x": Origin("x")}, content)
    sentence = refusal({"x": Origin("bad")}, content)
    for word in ("data row 21", "channel bad", "nan"):
        assert word in sentence


# --- where it turns -----------------------------------------------------------------------------


@pytest.mark.parametrize(("turn", "taken"), [(1.56, True), (1.58, False)])
def test_an_angle_may_turn_a_quarter_between_two_samples(turn, taken):
    content = two_rates(angle=np.mod(turn * np.arange(20), 2 * np.pi))
    if taken:
        _, channels = mapped(ORIGINS, content, resample=True)
        turned = np.unwrap(channels["angle"])
        assert turned[-1] - turned[0] == pytest.approx(19 * turn)
    else:
        assert "channel angle turns 1.58 rad" in refusal(ORIGINS, content, resample=True)


def test_a_clock_that_begins_later_cuts_the_others():
    """The slow channels begin at 23 ms and end at 213 ms, the fast one ends at 199 ms."""
    late = 0.023 + np.arange(20) * 10 * STEP
    step, channels = mapped(ORIGINS, two_rates(slow_times=late), resample=True)
    time = np.arange(23, 200) * STEP
    assert step == pytest.approx(STEP, rel=1e-9)
    np.testing.assert_array_equal(channels["fast"], np.cos(50 * time))
    np.testing.assert_allclose(channels["slow"], 3.0 + 2.0 * time, rtol=1e-13)


def test_delays_of_several_channels_keep_what_all_of_them_have():
    rows = np.arange(40.0)
    content = table(late=np.roll(rows, 2), early=np.roll(rows, -3), row=rows)
    origins = {
        "late": Origin("late", delay=2),
        "early": Origin("early", delay=-3),
        "row": Origin("row"),
    }
    _, channels = mapped(origins, content)
    np.testing.assert_array_equal(channels["row"], np.arange(3.0, 38.0))
    np.testing.assert_array_equal(channels["late"], channels["row"])
    np.testing.assert_array_equal(channels["early"], channels["row"])


def test_a_share_has_its_scale_and_sign_and_the_whole_its_unit():
    content = table(dc=np.linspace(0.3, 0.4, 40))
    origin = Origin("duty", "V", "kV", scale=2.0, sign=-1, times="dc")
    _, channels = mapped({"u": origin}, content)
    wanted = -2.0 * np.linspace(0, 1, 40) * np.linspace(300, 400, 40)
    np.testing.assert_allclose(channels["u"], wanted, rtol=1e-13)
