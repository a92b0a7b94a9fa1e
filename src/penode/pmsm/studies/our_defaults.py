"""Our defaults as a method among others: nothing is told."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from penode.data.experiment import Experiment
from penode.horizon.ladder import Observer
from penode.identify import nobody
from penode.pmsm.study import Study, identify
from penode.training.fit import Fit


@dataclass(frozen=True)
class OurDefaults:
    """What `penode identify` does with a recording.

    Attributes
    ----------
    study : Study
        The defaults decide terms and horizon from the data.
    """

    study: Study = field(default_factory=Study)

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = nobody,
    ) -> Fit:
        """Return the fit; see `penode.pmsm.conventional.method.Method`."""
        return identify(experiments, study=self.study, validation=validation, observer=observer)
