"""What the provenance of a machine's fit says of how the model came about."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.standstill import SCOPE, STANDSTILL, stands_still
from penode.pmsm.machine.temperatures import RECORDED, recorded_temperatures
from penode.pmsm.machine.term_registry import completed, term_name
from penode.pmsm.machine.terms import SPEED, Term


class Decided(Protocol):
    """A model with nothing left open; a `penode.pmsm.Study` is one."""

    @property
    def flux_map(self) -> str:
        """A key of `penode.pmsm.machine.flux_maps.FLUX_MAPS`."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """Of the voltage equation."""

    @property
    def angle_orders(self) -> tuple[int, ...] | None:
        """Harmonics of the electrical angle."""

    @property
    def hold(self) -> str | None:
        """Frame in which a voltage is held."""

    @property
    def purpose(self) -> str:
        """What the horizon is chosen for."""

    @property
    def seed(self) -> int:
        """Of window placement."""

    @property
    def pole_pairs(self) -> int | None:
        """Of the machine."""


def facts_of(
    recordings: Sequence[Experiment], study: Decided, reasons: Sequence[str]
) -> dict[str, Any]:
    """Return the facts by name, without those that are not known.

    `reasons` say in sentences why the model is as it is.
    """
    speed = float(np.median(np.abs(recordings[0].channels[SPEED.name])))
    still = stands_still(recordings)
    facts = {
        "flux_map": study.flux_map,
        "inverter": any(term.role == DeadTime.role for term in study.terms),
        "terms": [term_name(term) for term in completed(study.terms)],
        "angle_orders": list(study.angle_orders or ()),
        "structure": [SCOPE, *reasons] if still else list(reasons),
        STANDSTILL: still or None,
        "hold": study.hold,
        "purpose": study.purpose,
        "seed": study.seed,
        "pole_pairs": study.pole_pairs,
        "electrical_frequency_hz": speed / (2 * np.pi),
        RECORDED: recorded_temperatures(recordings),
    }
    return {name: fact for name, fact in facts.items() if fact is not None}
