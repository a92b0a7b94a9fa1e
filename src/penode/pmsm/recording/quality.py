"""Quality of a drive's recordings: an axis that was left at rest is no fault of its channels."""

from collections.abc import Iterator, Sequence

from penode.data.experiment import Experiment
from penode.data.quality import Finding, inspect_stretches
from penode.data.stretches import by_recording
from penode.pmsm.machine.standstill import axes_at_rest
from penode.pmsm.recording.channels import electrical


def quality_of(experiments: Sequence[Experiment]) -> tuple[Finding, ...]:
    """Return what is odd in the voltages and currents of a drive's recordings.

    Commissioning tests excite one axis a file and log zeros of the other: these are no error, and
    worth a warning only where no recording excites that axis.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings in stretches, in any form of voltages and currents.

    Returns
    -------
    tuple of Finding
    """
    recordings = list(by_recording(experiments))
    return tuple(f for stretches in recordings for f in _findings(stretches, recordings))


def _findings(
    stretches: Sequence[Experiment], recordings: Sequence[Sequence[Experiment]]
) -> Iterator[Finding]:
    resting = {f"{kind}_{axis}" for axis in axes_at_rest(stretches) for kind in "ui"}
    yield from inspect_stretches(
        stretches, [name for name in electrical(stretches) if name not in resting]
    )
    for axis in axes_at_rest(stretches):
        if all(axis in axes_at_rest(other) for other in recordings):
            yield Finding(
                "warning",
                f"i_{axis}",
                f"{stretches[0].place.recording}: u_{axis} and i_{axis} are 0 throughout, so "
                f"nothing is learned of the {axis} axis; add a recording with current in it, if "
                "the map is to have both.",
            )
