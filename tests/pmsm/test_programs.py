"""Fits of one structure share their compiled programs within a process."""

from dataclasses import replace

import jax
import pytest
from jax import monitoring

from penode.bench.drive import DEFAULT_DRIVE
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.models.layout import Layout
from penode.pmsm.machine.coenergy_map import CoenergySplines
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

COMPILED = "/jax/core/compile/backend_compile_duration"


def record(seed, speed, duration):
    drive, reference = replace(DEFAULT_DRIVE, current_noise=0.05), Lissajous(240.0, 50.0, 54.0)
    return simulate(
        TRACTION_300A, reference, speed_rpm=speed, duration=duration, drive=drive, seed=seed
    )


@pytest.fixture
def compiled():
    """Return the list to which each compilation adds, one found in a cache on disk too."""
    events = []

    def listen(event, duration, **_):
        if event == COMPILED:
            events.append(event)

    monitoring.register_event_duration_secs_listener(listen)
    yield events
    monitoring.unregister_event_duration_listener(listen)


@pytest.mark.slow
def test_a_second_recording_compiles_nothing(compiled):
    """Another length, speed and noise; the first fit shows that compilations are counted."""
    study = Study(horizon=2, candidates=(), angle_orders=())
    first, second = record(0, 1500.0, 0.25), record(1, 1480.0, 0.2431)
    jax.clear_caches()
    identify([first], study=study)
    assert len(compiled) > 10
    compiled.clear()
    identify([second], study=study)
    assert not compiled


def test_layouts_of_one_structure_are_equal():
    def layout(resistance, reach=250.0, experiments=1):
        flux = FluxMap(CoenergySplines.linear(), reach, 0.1)
        return Layout(Machine(flux, (Resistance(resistance),)), experiments)

    assert layout(0.01) == layout(0.02)
    assert hash(layout(0.01)) == hash(layout(0.02))
    assert layout(0.01) != layout(0.01, reach=300.0)
    assert layout(0.01) != layout(0.01, experiments=2)
