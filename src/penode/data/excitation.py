"""Excitation: refusal of recordings in which a channel that has to move never does."""

from collections.abc import Iterable, Sequence

from penode.data.experiment import Experiment
from penode.data.quality import find_constant
from penode.errors import InputError


def check_excitation(experiment: Experiment, channels: Sequence[str]) -> None:
    """Refuse a recording in which a needed channel is missing or never moves."""
    for channel in channels:
        finding = find_constant(experiment, channel)
        if finding is not None:
            raise InputError(finding.sentence)


def check_some_excitation(experiment: Experiment, channels: Sequence[str]) -> None:
    """Refuse a recording in which none of several channels moves; see `check_excitation`.

    One axis at rest is no obstacle: a winding may be excited along the other alone. A channel that
    stands at anything but zero is stuck.
    """
    still = [name for name in channels if find_constant(experiment, name) is not None]
    stuck = [name for name in still if experiment.channels[name].any()]
    check_excitation(experiment, still if len(still) == len(channels) else stuck)


def check_any_excitation(stretches: Sequence[Experiment], groups: Iterable[Sequence[str]]) -> None:
    """Refuse a recording of several stretches if each would be, by `check_some_excitation`."""
    refusals, groups = [], tuple(groups)
    for stretch in (e for e in stretches if len(e) > 1):
        try:
            for channels in groups:
                check_some_excitation(stretch, channels)
        except InputError as refusal:
            refusals.append(refusal)
        else:
            return
    if refusals:
        raise refusals[0]
