"""Calibration of a drive's recordings: what their channels have to be corrected by.

When and in which frame the voltage acts, the angle of the d axis, and the current that the iron
takes are properties of the drive, not of the flux map; `penode.pmsm.balance.calibration_fit`
estimates them with the map, and `penode.pmsm.balance.drift` what changes over each recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from penode.data.experiment import Experiment
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE, KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, Accuracy, budget_rows


@dataclass(frozen=True)
class Calibration:
    """What recordings have to be corrected by: sizes of `IMPERFECTIONS` by name, none of 0."""

    sizes: Mapping[str, complex] = field(default_factory=dict)
    # Map and R beside them, and the hold of the voltages.
    drive: KnownDrive = UNKNOWN_DRIVE
    # Of what was estimated; of what was left alone, what it may be off by.
    deviation: Mapping[str, float] = field(default_factory=dict, compare=False)
    # Samples of rotation by which voltages seem turned, and the deviation, where it shows.
    turned: tuple[float, float] | None = field(default=None, compare=False)
    # What was estimated, a sentence each.
    reasons: tuple[str, ...] = field(default=(), compare=False)

    def __getitem__(self, name: str) -> Any:
        """Return a size, 0 for what is not corrected."""
        return self.sizes.get(name, 0.0)

    def knows(self, name: str) -> bool:
        """Return whether an estimated size is known well enough to tell its exact values apart."""
        return self.deviation.get(name, np.inf) < IMPERFECTIONS[name].near

    def applied(self, experiment: Experiment) -> Experiment:
        """Return the recording corrected, cut at its ends where no voltage was recorded."""
        for name, one in IMPERFECTIONS.items():
            if self[name]:
                experiment = one.corrected(experiment, self[name], self.drive)
        return experiment

    def acting(self, experiment: Experiment) -> Experiment:
        """Return an applied recording with each sample's mean voltage in the turning frame."""
        return self.drive.acting(experiment)

    def left(self, declared: Mapping[str, float]) -> dict[str, float]:
        """Return what is left of each, SI: as declared, narrowed by what the recordings show."""
        left = {}
        for name, one in IMPERFECTIONS.items():
            shown = self.deviation.get(name, np.inf)
            estimated = self[name] % one.exact if one.exact else self[name]
            left[name] = shown if estimated else min(declared.get(name, np.inf), shown)
        return {name: size for name, size in left.items() if size and np.isfinite(size)}

    def rows(
        self, accuracy: Accuracy, experiments: Sequence[Experiment]
    ) -> tuple[Imperfection, ...]:
        """Return the rows of the uncertainty budget of what is left."""
        declared = accuracy.deviations(experiments)
        left = self.left(declared)
        origins = {
            name: accuracy.origin(name) if size == declared[name] else "estimated"
            for name, size in left.items()
            if name in declared
        }
        return budget_rows(left, experiments, self.drive, origins)


AS_RECORDED = Calibration()
