"""Terms by name, the terms of a whole machine, and their physical parameters."""

from collections.abc import Sequence
from dataclasses import replace

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.pmsm.machine.dead_time import DeadTime, MeanDeadTime, PhaseDeadTime
from penode.pmsm.machine.terms import (
    Channel,
    MagnetTemperature,
    Resistance,
    Rotation,
    TemperatureResistance,
    Term,
)

#: Terms that a user can name, in study files and on the command line.
TERMS: dict[str, type[Term]] = {
    "resistance": Resistance,
    "temperature_resistance": TemperatureResistance,
    "magnet_temperature": MagnetTemperature,
    "dead_time": DeadTime,
    "phase_dead_time": PhaseDeadTime,
    "mean_dead_time": MeanDeadTime,
}


def terms_of(names: Sequence[str]) -> tuple[Term, ...]:
    """Return terms by name, with nothing known of their parameters; unknown names are refused."""
    for name in names:
        if name not in TERMS:
            raise InputError(f"unknown term {name!r}; known are {', '.join(TERMS)}.")
    return tuple(TERMS[name]() for name in names)


def completed(terms: Sequence[Term]) -> tuple[Term, ...]:
    """Return terms with the resistance and the rotation, which every machine has, added.

    A term of the role of one of these two stands in its place; two of one role are refused.
    """
    roles = [term.role for term in terms]
    twice = next((role for role in roles if roles.count(role) > 1), None)
    if twice is not None:
        names = " and ".join(type(term).__name__ for term in terms if term.role == twice)
        raise InputError(f"{names} both describe the {twice}; remove one of them.")
    first = () if "resistance" in roles else (Resistance(),)
    last = () if "rotation" in roles else (Rotation(),)
    return (*first, *terms, *last)


def channels_of(terms: Sequence[Term]) -> dict[str, Channel]:
    """Return the channels that terms need, by name."""
    return {channel.name: channel for term in terms for channel in term.channels}


def term_name(term: Term) -> str:
    """Return the key of a term in `TERMS`, or the name of its class where it is not there."""
    names = {kind: name for name, kind in TERMS.items()}
    return names.get(type(term), type(term).__name__)


def physical_places(terms: Sequence[Term]) -> tuple[tuple[int, str], ...]:
    """Return the place of each physical parameter: its term, and the name of its field."""
    places = []
    for place, term in enumerate(terms):
        for name, declared in type(term).__dataclass_fields__.items():
            setting = declared.metadata.get("setting")
            if setting is not None and setting.physical:
                places.append((place, name))
    return tuple(places)


def physical_values(terms: Sequence[Term]) -> dict[str, float]:
    """Return the physical parameters of terms by name, SI units."""
    return {name: float(getattr(terms[at], name)) for at, name in physical_places(terms)}


def with_physical(terms: Sequence[Term], values: Sequence[float] | FloatArray) -> tuple[Term, ...]:
    """Return terms with other physical parameters, in the order of `physical_places`, SI units."""
    changed = list(terms)
    for (place, name), value in zip(physical_places(terms), values, strict=True):
        changed[place] = replace(changed[place], **{name: value})
    return tuple(changed)
