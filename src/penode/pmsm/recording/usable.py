"""Which stretches of drive recordings can be used."""

from collections.abc import Sequence

from penode.data.experiment import Experiment
from penode.data.stretches import by_recording, with_reason
from penode.errors import InputError
from penode.pmsm.recording.channels import drive_recording


def usable_stretches(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Return recordings without the stretches that say nothing of a machine.

    Parameters
    ----------
    experiments : sequence of Experiment
        As a study file maps them, whole or in stretches.

    Returns
    -------
    tuple of Experiment
        Whole recordings as they are. Of others the stretches in which currents and voltages move,
        or all where there are none; they say what was left out.
    """
    return tuple(e for stretches in by_recording(experiments) for e in _excited(stretches))


def _excited(stretches: Sequence[Experiment]) -> Sequence[Experiment]:
    kept, refusals = [], []
    for stretch in stretches:
        try:
            drive_recording(stretch)
        except InputError as refusal:
            refusals.append(str(refusal))
        else:
            kept.append(stretch)
    if not kept or not refusals:
        return stretches
    more = f" So are {len(refusals) - 1} more stretches." if len(refusals) > 1 else ""
    return [with_reason(e, f"Left out: {refusals[0]}{more}") for e in kept]
