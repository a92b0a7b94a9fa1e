"""Every notebook runs from its first cell to its last, and is kept without what it printed."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))

# The code as it is, at shorter horizons: long ones are trained by other tests.
SHORTER = {"horizon=20": "horizon=3", "(1, 3, 10, 30, 100)": "(1, 3, 10, 30)"}


def test_there_are_two_notebooks():
    assert len(NOTEBOOKS) == 2


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_kept_without_outputs(path):
    cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells)


@pytest.mark.parametrize(
    "path",
    # The first is the tutorial, whose commands and code run in test_docs, as a notebook.
    [
        pytest.param(p, marks=pytest.mark.slow if p == NOTEBOOKS[0] else (), id=p.stem)
        for p in NOTEBOOKS
    ],
)
def test_notebook_runs(path, tmp_path, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    # Compiled in half the time, and run slower: these recordings are short.
    monkeypatch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        for printed, shorter in SHORTER.items():
            cell.source = cell.source.replace(printed, shorter)
    client = NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    printed = [o for cell in notebook.cells for o in cell.get("outputs", [])]
    assert any(o.output_type == "stream" for o in printed)
