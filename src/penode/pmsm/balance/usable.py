"""Which stretches of drive recordings can be used."""

from collections.abc import Sequence

from penode.data.experiment import Experiment
from penode.data.gathered import PIECE
from penode.data.stretches import SHORTEST, by_recording, with_reason
from penode.errors import InputError
from penode.pmsm.balance.voltage_limit import below_limit
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.recording.spikes import without_spikes


def usable_stretches(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Return recordings without what says nothing of a machine, or what did not act.

    Whole recordings lose spikes and, where that shows, the samples at the voltage limit; of
    stretches those are kept in which currents and voltages move, or all where there are none.
    They say what was left out.
    """
    recordings = (_excited(without_spikes(each)) for each in by_recording(experiments))
    return tuple(e for stretches in recordings for e in _excited(below_limit(stretches)))


def require_samples(experiments: Sequence[Experiment]) -> None:
    """Raise if no stretch is long enough to identify a machine from."""
    longest = max(experiments, key=len)
    if len(longest) < SHORTEST:
        raise InputError(
            f"{longest.name}: a machine needs at least {SHORTEST} samples in a row, got "
            f"{len(longest)}; record for longer."
        )


def left_out(given: Sequence[Experiment], usable: Sequence[Experiment]) -> str:
    """Return how many samples are not usable, in a sentence; empty where all are."""
    whole, used = (sum(map(len, experiments)) for experiments in (given, usable))
    lost = whole - used
    return f"{lost} of {whole} samples {'was' if lost == 1 else 'were'} left out." if lost else ""


def _excited(stretches: Sequence[Experiment]) -> Sequence[Experiment]:
    """Return the stretches in which the drive does something; long ones are not looked at."""
    kept, refusals = [], []
    for stretch in stretches:
        try:
            if len(stretches) > 1 and len(stretch) <= PIECE:
                drive_recording(stretch)
        except InputError as refusal:
            refusals.append(str(refusal))
        else:
            kept.append(stretch)
    if not kept or not refusals:
        return stretches
    more = f" So are {len(refusals) - 1} more stretches." if len(refusals) > 1 else ""
    return [with_reason(e, f"Left out: {refusals[0]}{more}") for e in kept]
