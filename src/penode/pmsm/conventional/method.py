"""What every method of identification has in common."""

from collections.abc import Sequence
from typing import Protocol

from penode.data.experiment import Experiment
from penode.horizon.ladder import Observer
from penode.identify import nobody
from penode.training.fit import Fit


class Method(Protocol):
    """Anything that finds a machine's resistance and flux-linkage map from recordings."""

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = nobody,
    ) -> Fit:
        """Return the fit.

        Parameters
        ----------
        experiments, validation : sequence of Experiment
            With i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s); the latter are predicted only.
        observer : callable
            Told of each evaluation and rung, where the method has any.
        """
        ...
