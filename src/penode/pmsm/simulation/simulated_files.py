"""A simulated recording as files: the recording, and the truth beside it."""

from pathlib import Path

import numpy as np

from penode.bench.run import Recording
from penode.bench.truth import truth_of
from penode.data.save import save
from penode.fit.archive import to_json, write_atomically

#: Points a side of the grid of the true map.
GRID = 61


def write_recording(recording: Recording, path: Path) -> tuple[Path, Path]:
    """Write the recording (.csv or .parquet), and beside it how it was made and the map behind it.

    Those are ``NAME.truth.json``, and ``NAME.truth.csv`` with i_d, i_q in A and psi_d, psi_q in Vs:
    the map averaged over the angle, on a grid over the disc of visited currents.
    """
    save(recording.experiment, path)
    story, table = truth_file(path), path.with_suffix(".truth.csv")
    write_atomically(story, to_json(truth_of(recording.truth)))
    write_atomically(table, _true_map(recording))
    return story, table


def truth_file(path: Path) -> Path:
    """Return where the truth of a simulated recording is."""
    return path.with_suffix(".truth.json")


def _true_map(recording: Recording) -> str:
    reach = float(np.linalg.norm(recording.truth.trace.current, axis=-1).max())
    axis = np.linspace(-reach, reach, GRID)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    points = points[np.linalg.norm(points, axis=1) <= reach]
    rows = np.column_stack([points, recording.truth.flux_map(*points.T)])
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join(["i_d,i_q,psi_d,psi_q", *lines]) + "\n"
