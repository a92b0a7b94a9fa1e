"""Our defaults as a method among others: no setting is given."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.horizon.ladder import Observer, ignore_events
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study


@dataclass(frozen=True)
class OurDefaults:
    """What `penode identify` does: terms and horizon from the data; exact simulated sensors."""

    study: Study = field(default_factory=lambda: Study(accuracy=Accuracy.exact()))

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return the fit; see `penode.paper.conventional.method.Method`."""
        return identify(experiments, study=self.study, validation=validation, observer=observer)
