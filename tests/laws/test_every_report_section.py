"""Every section of every report: it renders for any fit, whole and without a "nan" in its text."""

import html
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment
from penode.fit.fit import HorizonChoice, HorizonSummary
from penode.fit.outcome import Objection
from penode.pmsm.machine.standstill import STANDSTILL
from penode.pmsm.report.machine_report import MACHINE_PAGE
from penode.report.document import Document
from penode.report.fit_report import Page
from penode.report.html import render
from penode.validation.comparison import Comparison
from penode.validation.residual_tests import Spectrum, residual_correlations

STEP, COUNT = 1e-4, 2000
PAGES = {"any model": Page(), "machine": MACHINE_PAGE}


def with_predictions(fit):
    """Give a machine's fit a ladder, two recordings beside predictions, and their spectrum."""
    random, time = np.random.default_rng(5), STEP * np.arange(COUNT)
    measured = np.column_stack([100 * np.sin(90 * time), 100 * np.sin(95 * time + 1)])

    def beside(name, role):
        parts = (measured + size * random.normal(size=measured.shape) for size in (0.1, 0.3))
        return Comparison(name, role, STEP, ("i_d", "i_q"), ("A", "A"), measured, *parts)

    train, unseen = beside("run.csv", "train"), beside("unseen.csv", "validation")
    amplitude = np.abs(np.fft.rfft(train.measured - train.one_step, axis=0)) / COUNT
    inputs = dict.fromkeys(fit.model.inputs, measured[:, 0])
    run = Experiment("run.csv", STEP, {"i_d": measured[:, 0], "i_q": measured[:, 1], **inputs})
    ladder = tuple(
        HorizonSummary(h, {"R": 0.01 + 1e-5 * k}, {"R": 1e-4}, 0.1, 0.3, 2, "Done.")
        for k, h in enumerate((1, 8, 50))
    )
    return replace(
        fit,
        horizon=HorizonChoice(50, "plateau", "Horizons agree.", ladder, (1, 8, 50)),
        comparisons=(train, unseen),
        spectrum=Spectrum("run.csv", np.fft.rfftfreq(COUNT, STEP), amplitude),
        correlations=residual_correlations(train, run, fit.model.inputs),
        provenance={**fit.provenance, "electrical_frequency_hz": 95.0},
    )


@pytest.fixture(scope="module", params=PAGES)
def kind(request):
    """Return a good fit and the page that reports it."""
    page = PAGES[request.param]
    if request.param == "any model":
        return request.getfixturevalue("oscillator").fit, page
    return with_predictions(request.getfixturevalue("machine_fit")), page


def judged(verdict, *objections):
    def changed(fit):
        return replace(
            fit, horizon=replace(fit.horizon, verdict=verdict, objections=tuple(objections))
        )

    return changed


def still(fit):
    """A fit as of a standstill: at rest, nothing known of the magnet."""
    return replace(
        fit, provenance={**fit.provenance, STANDSTILL: True, "electrical_frequency_hz": 0.0}
    )


def without_validation(fit):
    return replace(fit, comparisons=tuple(one for one in fit.comparisons if one.role == "train"))


def no_numbers(fit):
    """A fit whose training went wrong: estimates and predictions are no numbers."""
    lost = {
        name: replace(one, value=np.nan, std=np.inf, interval_95=(-np.inf, np.inf))
        for name, one in fit.parameters.items()
    }
    diverged = tuple(
        replace(one, free_run=np.full_like(one.free_run, np.nan)) for one in fit.comparisons
    )
    rungs = tuple(
        replace(one, std=dict.fromkeys(one.std, np.inf), free_run_rmse=np.inf)
        for one in fit.horizon.ladder
    )
    choice = replace(fit.horizon, verdict="no plateau", ladder=rungs)
    return replace(fit, parameters=lost, comparisons=diverged, horizon=choice)


OBJECTION = Objection("free run fails", "run.csv: it errs.", "Look for a broken convention.")
FITS = {
    "good": lambda fit: fit,
    "no plateau": judged("no plateau"),
    "not identifiable": judged("not identifiable"),
    "stopped": judged("stopped"),
    "implausible": judged("implausible", OBJECTION),
    "standstill": still,
    "without validation": without_validation,
    "without predictions": lambda fit: replace(fit, comparisons=()),
    "without ladder": lambda fit: replace(fit, horizon=replace(fit.horizon, ladder=())),
    "no numbers": no_numbers,
}


def visible(page):
    """Return the text of a page that a reader sees."""
    for element in ("script", "style", "svg"):
        first, *rest = page.split(f"<{element}")
        page = " ".join([first, *(part.partition(f"</{element}>")[2] for part in rest)])
    return html.unescape(re.sub(r"<[^>]*>", " ", page))


def check(text):
    assert "Left out" not in text, text[text.index("Left out") :][:300]
    assert not re.search(r"\b(nan|none|inf)\b(?! of)", text), re.findall(
        r".{60}\b(?:nan|none|inf)\b.{30}", text
    )


@pytest.mark.parametrize("of", FITS)
def test_every_section_renders(kind, of):
    good, page = kind
    fit = FITS[of](good)
    for part in page.all_parts():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            section = part(fit)
        if section is not None:
            check(visible(render(Document("x", "x", "x", [], [section]))))


@pytest.mark.parametrize("of", FITS)
def test_the_head_of_the_page_renders(kind, of):
    good, page = kind
    check(visible(render(replace(page, parts=()).document(FITS[of](good)))))


def test_a_good_fit_has_every_section(kind):
    fit, page = kind
    absent = [part.__name__ for part in page.all_parts() if part(fit) is None]
    assert set(absent) <= {"uncertainty_budget", "loss_weighting", "points_balance"}
