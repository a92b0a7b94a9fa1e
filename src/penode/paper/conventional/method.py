"""What every method of identification has in common."""

from collections.abc import Sequence
from typing import Protocol

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.horizon.ladder import Observer, ignore_events


class Method(Protocol):
    """Anything that finds a machine's resistance and flux-linkage map from recordings."""

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return the fit of recordings; those for validation are predicted only.

        They need i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s). The observer sees each
        evaluation and rung, where the method has any.
        """
        ...
