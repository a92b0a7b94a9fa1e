"""Units: what files call them, and what one is in SI."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from penode.arrays import FloatArray
from penode.errors import InputError, did_you_mean


@dataclass(frozen=True)
class Unit:
    """One unit: ``SI value = value * numerator / denominator + offset``.

    Two numbers, because a division by 1000 is rounded once, and a product with 1e-3 twice. The
    offset is in the SI unit; temperatures count in degC, as drive engineers do.
    """

    si: str
    numerator: float = 1.0
    denominator: float = 1.0
    offset: float = 0.0

    def to_si(self, values: FloatArray, factor: float = 1.0) -> FloatArray:
        """Return values in SI units; ``factor`` is what one count of them is in this unit."""
        if factor * self.numerator == self.denominator == 1.0 and not self.offset:
            return values
        scaled = values * (factor * self.numerator) / self.denominator
        return scaled + self.offset if self.offset else scaled


#: Name -> unit. Files may put brackets around a name and spell it as `_ALIASES` lists.
UNITS: Mapping[str, Unit] = MappingProxyType(
    {
        "s": Unit("s"),
        "ms": Unit("s", denominator=1e3),
        "us": Unit("s", denominator=1e6),
        "ns": Unit("s", denominator=1e9),
        "V": Unit("V"),
        "mV": Unit("V", denominator=1e3),
        "kV": Unit("V", numerator=1e3),
        "A": Unit("A"),
        "mA": Unit("A", denominator=1e3),
        "kA": Unit("A", numerator=1e3),
        "rad": Unit("rad"),
        "deg": Unit("rad", math.pi, 180.0),
        "turn": Unit("rad", 2.0 * math.pi),
        "rad/s": Unit("rad/s"),
        "deg/s": Unit("rad/s", math.pi, 180.0),
        "rpm": Unit("rad/s", 2.0 * math.pi, 60.0),
        "Hz": Unit("rad/s", 2.0 * math.pi),
        "degC": Unit("degC"),
        "K": Unit("degC", offset=-273.15),
        "degF": Unit("degC", 5.0, 9.0, -160.0 / 9.0),
        "Nm": Unit("Nm"),
        "mNm": Unit("Nm", denominator=1e3),
        "1": Unit("1"),
        "%": Unit("1", denominator=100.0),
    }
)
_ALIASES = {
    alias: name
    for name, aliases in {
        "1": ("-", "pu", "p.u.", "per unit"),
        "degC": ("°C", "\N{DEGREE CELSIUS}", "C", "celsius", "Celsius"),
        "K": ("kelvin", "Kelvin"),
        "degF": ("°F",),
        "s": ("sec", "second", "seconds", "Sekunden"),
        "us": ("\N{MICRO SIGN}s", "\N{GREEK SMALL LETTER MU}s"),
        "V": ("Volt", "volt"),
        "A": ("Amp", "Ampere"),
        "deg": ("°", "Grad", "degree", "degrees"),
        "turn": ("rev", "U"),
        "Hz": ("1/s", "rev/s"),
        "rpm": ("RPM", "1/min", "min-1", "min^-1", "U/min", "rev/min", "r/min"),
        "rad/s": ("rads/s", "rad*s^-1"),
        "deg/s": ("°/s",),
    }.items()
    for alias in aliases
}


def unit_name(text: str) -> str | None:
    """Return the key of `UNITS` for a unit as spelt, ``"[1/min]"``, or None; case matters."""
    bare = text.strip().strip("[](){}").strip()
    name = _ALIASES.get(bare, bare)
    return name if name in UNITS else None


def find_unit(where: str, text: str) -> Unit:
    """Return the unit spelt so; refuse an unknown one, with the nearest suggested."""
    name = unit_name(text)
    if name is None:
        spellings = [*_ALIASES, *UNITS]
        raise InputError(
            f"{where}: unknown unit {text!r}{did_you_mean(text, spellings)}; use one of "
            f"{', '.join(UNITS)}, and scale for what is left."
        )
    return UNITS[name]
