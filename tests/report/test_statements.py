"""Sentences of a report: each verdict has its tone and meaning, and no claim exceeds the data."""

from dataclasses import replace

import numpy as np
import pytest

from penode.fit.outcome import AGREED, Estimate
from penode.report.statements import (
    estimate_text,
    ladder_title,
    listed,
    overlay_title,
    range_text,
    spectrum_title,
    verdict_notice,
    warning_notices,
)
from penode.validation.residual_tests import Spectrum

GAP = "\N{NO-BREAK SPACE}"
VERDICTS = (
    *("plateau", "H = 1 suffices", "predicts best", "fixed", "stopped"),
    *("no plateau", "not identifiable", "implausible"),
)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_red_is_for_refusals_and_green_for_what_was_tested(choice, verdict):
    made = replace(choice, verdict=verdict)
    notice = verdict_notice(made)
    assert (notice.tone == "refusal") == (not made.answered)
    assert (notice.tone == "good") == (verdict in AGREED)
    told = notice.text.replace(choice.reason, "").strip()
    assert told.endswith("."), "the reason alone does not say what follows from it"
    assert notice.text == " ".join(notice.text.split())
    assert (f"(verdict: {verdict})" in notice.label) == (notice.tone != "caution")


def test_what_was_not_tested_and_what_was_stopped_are_told_apart(choice):
    labels = [
        verdict_notice(replace(choice, verdict=verdict)).label
        for verdict in ("fixed", "predicts best", "stopped")
    ]
    assert labels == [
        "Not tested: the horizon was given",
        "Not tested: the horizon was chosen for its predictions",
        "Stopped before the end",
    ]


def test_warnings_are_counted_in_one_box():
    assert warning_notices([]) == []
    for warnings, label in ((("a.",), "One warning"), (("a.", "b."), "2 warnings")):
        (notice,) = warning_notices(warnings)
        assert (notice.tone, notice.label, notice.points) == ("caution", label, warnings)


def test_words_are_listed_as_people_do():
    assert [listed(words) for words in ((), "a", "ab", "abc")] == [
        "nothing",
        "a",
        "a and b",
        "a, b and c",
    ]


def test_an_estimate_without_unit_ends_with_its_digits():
    assert estimate_text(Estimate.of(0.5, 0.012, "")) == ("0.500", "0.476 to 0.524")


def test_a_range_has_the_digits_of_a_tenth_of_its_width():
    assert range_text([10.0, 10.5], "V") == f"10.000 to 10.500{GAP}V"
    assert range_text([np.inf, -3.0, 2.0], "1/s") == f"−3.00 to 2.00{GAP}1/s"


@pytest.mark.parametrize(("gap", "agrees"), [(1.95, True), (1.97, False)])
def test_horizons_are_the_same_where_their_intervals_meet(fit, gap, agrees):
    """A plateau may hold rungs that differ by more than both half widths: it then has a range."""
    first, last = fit.horizon.ladder[3], fit.horizon.ladder[5]
    apart = first.parameters["mass"] + gap * (first.std["mass"] + last.std["mass"])
    moved = replace(last, parameters={**last.parameters, "mass": apart})
    fit.horizon = replace(fit.horizon, ladder=(first, moved), selected=10, plateau=(10, 50))
    assert ("is the same within its uncertainty" in ladder_title(fit, "mass")) == agrees


@pytest.mark.parametrize("verdict", ["implausible", "not identifiable"])
def test_agreement_is_not_claimed_of_a_refused_result(fit, verdict):
    fit.horizon = replace(fit.horizon, verdict=verdict)
    title = ladder_title(fit, "mass")
    assert title == f"{verdict.capitalize()}: mass spans 1.018 to 1.900{GAP}kg over the horizons"


def test_a_recording_says_whether_it_was_trained_on(comparison):
    assert overlay_title(comparison).startswith("cart.csv (used for training), rms error")
    unseen = replace(comparison, role="validation")
    assert overlay_title(unseen).startswith("cart.csv (not used for training), rms error")


def peaked(frequency, column=0, constant=0.0):
    """Return a spectrum with one line, bins of 0.04 Hz."""
    found = 0.04 * np.arange(5001)
    amplitude = np.zeros((5001, 2))
    amplitude[round(frequency / 0.04), column] = 1.0
    amplitude[0] = constant
    return Spectrum("run.csv", found, amplitude)


SAME = (("i_d", "A"), ("i_q", "A"))


@pytest.mark.parametrize(
    ("peak", "line", "named"),
    [
        (2.0, 2.09, True),  # within two and a half bins
        (2.0, 2.11, False),
        (100.0, 103.0, True),  # within 3 %
        (100.0, 97.0, False),
    ],
)
def test_a_peak_is_named_after_a_line_that_it_may_be(peak, line, named):
    title = spectrum_title(peaked(peak), SAME, [(40.0, "slots"), (line, "6×"), (160.0, "12×")])
    assert title.endswith("Hz, 6×") == named
    assert title.endswith("Hz") == (not named)


def test_noise_has_no_line_and_the_strongest_line_below_its_floor_is_named():
    noise = np.random.default_rng(4).rayleigh(size=(5001, 2)) * np.linspace(0.1, 1, 5001)[:, None]
    found = 0.04 * np.arange(5001)
    lines = [(199.0, "42×")]
    assert spectrum_title(Spectrum("run.csv", found, noise), SAME, lines).startswith("No line")
    noise[500, 0] = 2.0
    title = spectrum_title(Spectrum("run.csv", found, noise), SAME, lines)
    assert title == f"The strongest line of the residual lies in {SAME[0][0]}, at 20.0{GAP}Hz"


def test_the_strongest_line_is_that_of_most_power_however_wide_it_is():
    spectrum = peaked(60.0)
    spectrum.amplitude[2470:2531, 1] = 0.5  # about 100 Hz; its root sum of squares is 3.9
    assert spectrum_title(spectrum, SAME).endswith(f"at 100{GAP}Hz")


def test_a_constant_residual_is_no_line():
    assert spectrum_title(peaked(60.0, constant=9.0), SAME).endswith(f"at 60.0{GAP}Hz")


def test_a_state_without_residual_is_not_named():
    units = (("i", "A"), ("omega", "rad/s"))
    assert spectrum_title(peaked(60.0, 1), units) == (
        f"The strongest lines of the residual: omega at 60.0{GAP}Hz"
    )
