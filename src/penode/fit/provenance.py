"""Provenance: with which versions and from which data a fit was made."""

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

from penode.data.experiment import Experiment
from penode.fit.fit import unused

_PACKAGES = ("penode", "jax", "numpy", "scipy", "optax")


def penode_version() -> str:
    """Return the installed version of penode, by which kept results are recognised."""
    return version("penode")


def versions() -> dict[str, str]:
    """Return the installed version of every package that computes, by name."""
    return {name: version(name) for name in _PACKAGES}


def provenance_of(experiments: Sequence[Experiment]) -> dict[str, Any]:
    """Return versions of the packages that compute, and a hash of each recording."""
    data: dict[str, str] = {}
    for experiment in experiments:
        recording, digest = experiment.place.recording, experiment.source.sha256
        if experiment.stretch is None or data.get(recording) != digest:
            data[unused(recording, data)] = digest
    return {"versions": versions(), "data": data}
