"""The temperatures that a machine's resistance and flux map belong to, for files that hold both."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.pmsm.machine.terms import (
    MAGNETS,
    REFERENCE,
    TEMPERATURE,
    MagnetTemperature,
    TemperatureResistance,
    Term,
)

#: Entry of the provenance: of each temperature that was recorded mean, lowest and highest in degC,
#: nothing where only some of the recordings have it.
RECORDED = "recorded_temperatures"
#: How the name of a channel ends that is one, and the one that the map belongs to.
_CHANNELS, _MAGNET = "_temperature", MAGNETS.name

_OF_WINDING = "R is that of the winding, with cable and switches where the voltages are commands,"

Range = tuple[float, float, float]


@dataclass(frozen=True)
class Temperatures:
    """What is known of them; the sentences are plain ASCII and say so where nothing is."""

    # That R belongs to, degC.
    resistance: float | None = None
    # Change of R a kelvin over R, at that temperature, 1/K; None without a term of it.
    coefficient: float | None = None
    # That the flux map belongs to, degC.
    magnets: float | None = None
    of_resistance: str = f"{_OF_WINDING} at a temperature not known."
    of_map: str = "The map is that of the magnets as recorded, at a temperature not known."

    @property
    def sentences(self) -> str:
        """Both sentences, or that of the map alone."""
        return f"{self.of_resistance} {self.of_map}".strip()

    def without_resistance(self) -> "Temperatures":
        """Return what is known of the map alone."""
        return Temperatures(None, None, self.magnets, "", self.of_map)

    def doubted(self, verdict: str) -> "Temperatures":
        """Return the same of a map whose identification ended with a verdict of no answer."""
        doubt = f"The verdict is {verdict!r}: R is left out, and the map is as doubtful as R."
        return replace(self, of_map=f"{doubt} {self.of_map}")


UNKNOWN = Temperatures()


def recorded_temperatures(recordings: Sequence[Experiment]) -> dict[str, list[float]] | None:
    """Return mean, lowest and highest of every temperature of all recordings, degC.

    Its channels end in ``_temperature``; of one that is not in all recordings nothing is returned,
    and one with values that no machine's temperature in degC has is left out.
    """
    names = {name for each in recordings for name in each.channels if name.endswith(_CHANNELS)}
    found = {}
    for name in sorted(names):
        if not all(name in each.channels for each in recordings):
            found[name] = list[float]()
            continue
        values = np.concatenate([each.channels[name] for each in recordings])
        if (TEMPERATURE.lowest <= values).all() and (values <= TEMPERATURE.highest).all():
            found[name] = [float(part) for part in (values.mean(), values.min(), values.max())]
    return found or None


def temperatures_of(fit: Fit) -> Temperatures:
    """Return what a machine's fit knows of the temperatures behind it."""
    entry: dict[str, Sequence[float]] = fit.provenance.get(RECORDED) or {}
    recorded = {name: (one[0], one[1], one[2]) for name, one in entry.items() if one}
    terms: Sequence[Term] = getattr(fit.model, "terms", ())
    winding, magnets = recorded.get(TEMPERATURE.name), recorded.get(_MAGNET)
    known = _resistance(terms, winding)
    if known[0] is None and entry.get(TEMPERATURE.name) == []:
        known = *known[:2], f"{known[2][:-1]}; not all recordings have that of the winding."
    warm = next((t for t in terms if isinstance(t, MagnetTemperature)), None)
    if warm is not None:
        slope = f"{float(warm.magnet_coefficient):.6g} Vs/K"
        text = (
            f"The map is that of the magnets at {REFERENCE:g} degC; at T its flux linkage in d is "
            f"{slope} times T - {REFERENCE:g} more."
        )
        return Temperatures(*known[:2], REFERENCE, known[2], text)
    beside = next((t for t in terms if _MAGNET in [c.name for c in t.channels]), None)
    if beside is not None:
        text = f"The map is what is left beside the term {type(beside).__name__} of {_MAGNET}."
        return Temperatures(*known[:2], None, known[2], text)
    if magnets is not None:
        text = f"The map is that of the magnets at {_text(magnets)}."
        return Temperatures(*known[:2], magnets[0], known[2], text)
    text = UNKNOWN.of_map
    if winding is not None:
        text = f"{text[:-1]}; the winding had {_text(winding)}."
    return Temperatures(*known[:2], None, known[2], text)


def _resistance(
    terms: Sequence[Term], winding: Range | None
) -> tuple[float | None, float | None, str]:
    """Return temperature and coefficient of R, and both as a sentence."""
    for term in terms:
        if isinstance(term, TemperatureResistance):
            slope = f"R (1 + {term.alpha:.6g} (T - {REFERENCE:g}))"
            text = (
                f"R is that at {REFERENCE:g} degC; at a temperature T of the winding it is {slope}."
            )
            return REFERENCE, term.alpha, text
    if winding is None:
        return None, None, UNKNOWN.of_resistance
    return winding[0], None, f"{_OF_WINDING} at {_text(winding)}."


def _text(temperature: Range) -> str:
    mean, low, high = temperature
    lowest, highest = f"{low:.4g}", f"{high:.4g}"
    span = "" if lowest == highest else f" (recorded: {lowest} to {highest})"
    return f"{mean:.4g} degC{span}"
