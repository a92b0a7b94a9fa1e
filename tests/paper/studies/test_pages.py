"""Figures, pages and files of studies."""

import csv
import json

import matplotlib.pyplot as plt
import numpy as np
import pytest

from penode.errors import InputError
from penode.paper.studies.panels import Claim, Matrix, Panel, Series, StudyResult
from penode.paper.studies.reproduce import STUDIES, chosen_studies, reproduce
from penode.paper.studies.study_figure import COLOURS, study_figure
from penode.paper.studies.variants import AXES, FULL, QUICK


@pytest.fixture
def result():
    series = Series("paper", (1, 10, 10), (-70.0, 2.0, np.inf), "paper")
    panel = Panel("R", "H", "mΩ", (series,), truth=10.0, y_limits=(-20.0, 20.0))
    matrix = Matrix("error", "x", "y", ("a",), ("b", "c", "d"), [[1.0, np.inf, np.nan]])
    rows = [{"method": "paper", "R_mohm": 2.0}, {"method": "none", "refusal": "it never dwells."}]
    claims = (Claim("R is negative.", True, "-70 mΩ."), Claim("It stays so.", False, "2 mΩ."))
    columns = ("method", "R_mohm", "refusal")
    return StudyResult(
        "small", "A small study", "Why?", rows, (panel, matrix), claims, "So.", columns
    )


def test_figures_are_png_of_all_panels(result):
    content = study_figure(result.panels)
    assert content.startswith(b"\x89PNG")
    assert not plt.get_fignums()
    assert content != study_figure(result.panels[:1])


def test_every_variant_has_its_colour():
    assert {variant.name for variant in AXES} <= set(COLOURS)
    assert len({COLOURS[variant.name] for variant in AXES}) == len(AXES)


@pytest.mark.parametrize("extent", [QUICK, FULL])
def test_everything_is_written(result, extent, tmp_path, monkeypatch):
    monkeypatch.setitem(STUDIES, "small", lambda runs: result)
    written, _ = reproduce(["small"], tmp_path, extent, lambda text: None)
    page = written.read_text()
    assert "(figures/studies_small.png)" in page
    assert "| paper | 2 |" in page
    assert "| none | – |" in page
    assert ("--quick" in page) == (extent is QUICK)
    assert (tmp_path / "figures" / "studies_small.png").read_bytes().startswith(b"\x89PNG")
    document = json.loads((tmp_path / "small.json").read_text())
    assert document["provenance"]["versions"]["penode"]
    assert document["provenance"]["wall_time_s"] >= 0
    assert document["rows"][0]["R_mohm"] == 2.0
    table = list(csv.DictReader((tmp_path / "small.csv").open()))
    assert [row["R_mohm"] for row in table] == ["2", ""]


def test_the_page_lists_what_holds(result, tmp_path, monkeypatch):
    monkeypatch.setitem(STUDIES, "small", lambda runs: result)
    said = []
    page = reproduce(["small"], tmp_path, FULL, said.append)[0].read_text()
    assert said == ["small: 1 of 2 statements hold"]
    assert "| [A small study](#a-small-study) | 1 | 1 |" in page
    assert "- **Holds.** R is negative.\n  -70 mΩ." in page
    assert "- **Differs.** It stays so." in page


def test_a_quick_run_judges_nothing(result, tmp_path, monkeypatch):
    monkeypatch.setitem(STUDIES, "small", lambda runs: result)
    said = []
    page = reproduce(["small"], tmp_path, QUICK, said.append)[0].read_text()
    sentence = "quick numbers prove nothing, and its statements are not judged"
    assert said == [f"small: ran; {sentence}"]
    assert "| [A small study](#a-small-study) | not judged | not judged |" in page
    assert "- **Not judged.** R is negative.\n- **Not judged.** It stays so." in page
    assert "prove nothing" in page
    assert not any(word in page for word in ("Holds", "Differs", "-70 mΩ", "2 mΩ"))
    document = json.loads((tmp_path / "small.json").read_text())
    assert [claim["holds"] for claim in document["claims"]] == [None, None]


def test_unknown_studies_are_refused():
    assert chosen_studies("all") == list(STUDIES)
    assert chosen_studies("subdomain") == ["subdomain"]
    with pytest.raises(InputError, match="study must be all or one of resistance_vs_horizon"):
        chosen_studies("everything")
