"""``penode report`` of a model whose class lives in the user's own module."""

import importlib
import io
import sys
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from penode.cli import pdf
from penode.cli.fits import print_fit
from penode.fit.fit import Estimate, Fit, HorizonChoice, HorizonSummary
from penode.report.quantities import number
from penode.validation.comparison import Comparison
from penode.validation.residual_tests import Correlations, residual_spectrum

MODULE = """
import numpy as np

import penode


class Cart(penode.Model):
    states = ("position", "speed")
    state_units = ("m", "m/s")
    inputs = ("force",)
    map_units = {"drag": "N"}

    gain: object
    mass: object = penode.physical("kg", meaning="mass of the cart")

    def derivative(self, x, u):
        return x

    def maps(self):
        return {"drag": lambda speed: self.gain * np.tanh(speed)}
"""


def fit_of(model):
    """Return a fit that nothing was trained for: 400 samples, two horizons."""
    rng = np.random.default_rng(4)
    measured = np.cumsum(rng.normal(size=(400, 2)), axis=0)
    near = measured + rng.normal(0, 0.01, measured.shape)
    names, units = ("position", "speed"), ("m", "m/s")
    run = Comparison("run.csv", "train", 0.01, names, units, measured, near, near)
    rungs = tuple(
        HorizonSummary(h, {"mass": 1.5}, {"mass": 0.1}, 0.2, None, 5, "Done.", {"position": 0.1})
        for h in (1, 4)
    )
    return Fit(
        model,
        {"mass": Estimate.of(1.5, 0.1, "kg", meaning="mass of the cart")},
        HorizonChoice(4, "plateau", "Both agree.", rungs, (1, 4)),
        measured,
        (run,),
        residual_spectrum(run),
        correlations=Correlations(),
    )


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the folder with ``own_cart.py`` and ``fit/``; the module is not importable."""
    (tmp_path / "own_cart.py").write_text(MODULE)
    before = list(sys.path)
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("own_cart")
    fit_of(module.Cart(gain=np.array(2.0), mass=np.array(1.5))).save(tmp_path)
    monkeypatch.setattr(sys, "path", before)
    del sys.modules["own_cart"]
    yield tmp_path
    sys.modules.pop("own_cart", None)


def test_in_the_folder_of_the_module_the_report_is_written(folder, penode, monkeypatch):
    monkeypatch.chdir(folder)
    done = penode("report", folder, "--trust-classes")
    assert done.returncode == 0, done.stderr
    text = (folder / "report.html").read_text()
    assert "The mass of the cart is 1.50" in text
    assert "drag over speed: " in text
    assert "one-step rmse of speed in" in text


def test_the_page_is_printed_by_a_browser(folder, penode, monkeypatch, tmp_path_factory):
    """The browser is a script that takes Chromium's options and writes the page's name."""
    place = tmp_path_factory.mktemp("bin")
    script = place / "google-chrome"
    script.write_text(
        '#!/bin/sh\nfor one in "$@"; do case "$one" in --print-to-pdf=*) out="${one#*=}";; esac; '
        'done\ncase "$(cat "$0.fails" 2>/dev/null)" in yes) exit 1;; esac\necho "$one" > "$out"\n'
    )
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{place}:/usr/bin:/bin")
    monkeypatch.setattr(pdf, "_BROWSERS", ("google-chrome",))
    monkeypatch.chdir(folder)
    done = penode("report", folder, "--trust-classes", "--pdf")
    assert done.returncode == 0, done.stderr
    printed = folder / "report.pdf"
    assert printed.read_text().strip() == (folder / "report.html").resolve().as_uri()
    assert str(printed) in done.stdout

    (place / "google-chrome.fails").write_text("yes")
    printed.unlink()
    done = penode("report", folder, "--trust-classes", "--pdf")
    assert done.returncode == 2
    assert "did not print it (FileNotFoundError)" in done.stderr
    assert not printed.exists()

    (folder / "report.html").unlink()
    monkeypatch.setattr(pdf, "_BROWSERS", ("no-such-browser",))
    done = penode("report", folder, "--trust-classes", "--pdf")
    assert done.returncode == 2
    assert "--pdf needs Chromium or Chrome" in done.stderr
    assert not (folder / "report.html").exists()


def test_unasked_the_module_is_not_imported(folder, penode, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "own_cart.py").write_text("raise SystemExit('It was run.')")
    done = penode("report", folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "own_cart:Cart" in done.stderr
    assert "add --trust-classes" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (folder / "report.html").exists()


def test_elsewhere_one_sentence_names_the_module_and_the_way_out(folder, penode):
    done = penode("report", folder, "--trust-classes")
    assert done.returncode == 2
    assert done.stdout == ""
    sentence = done.stderr.strip()
    assert "\n" not in sentence
    for words in ("Cart", "own_cart", "PYTHONPATH", "run in the folder"):
        assert words in sentence
    assert not (folder / "report.html").exists()


def test_the_summary_has_an_error_a_state_where_units_differ(tmp_path):
    fit = fit_of(None)
    (run,) = fit.comparisons
    lost = replace(run, name="lost.csv", free_run=run.free_run * np.nan)
    printed = io.StringIO()
    print_fit(replace(fit, comparisons=(run, lost)), tmp_path, Console(file=printed))
    text = printed.getvalue()
    (x, v), (first, second) = run.one_step_errors.values(), run.free_run_errors.values()
    assert (
        f"run.csv: RMSE one step from a noisy sample position {number(x)} m, speed {number(v)} "
        f"m/s; free run position {number(first)} m, speed {number(second)} m/s" in text
    )
    assert "lost.csv: RMSE one step from a noisy sample position" in text
    assert "free run diverged" in text


def test_a_fit_without_one_step_predictions_has_a_report(folder, penode, monkeypatch):
    """As with a state that no sensor measures: no residual, so no section on it."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    fit = Fit.load(folder, trust=True)
    (run,) = fit.comparisons
    blind = replace(run, one_step=run.one_step * np.nan)
    replace(fit, comparisons=(blind,), spectrum=residual_spectrum(blind)).save(folder)
    done = penode("report", folder, "--trust-classes")
    assert done.returncode == 0, done.stderr
    text = (folder / "report.html").read_text()
    assert "Prediction against measurement" in text
    assert "What the model does not explain" not in text
