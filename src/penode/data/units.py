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
        "1": Unit("1"),
        "%": Unit("1", denominator=100.0),
    }
)
_ALIASES = {
    "-": "1",
    "pu": "1",
    "p.u.": "1",
    "per unit": "1",
    "°C": "degC",
    "\N{DEGREE CELSIUS}": "degC",
    "C": "degC",
    "celsius": "degC",
    "Celsius": "degC",
    "kelvin": "K",
    "Kelvin": "K",
    "°F": "degF",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "Sekunden": "s",
    "µs": "us",
    "μs": "us",  # the Greek letter, not the micro sign
    "Volt": "V",
    "volt": "V",
    "Amp": "A",
    "Ampere": "A",
    "°": "deg",
    "Grad": "deg",
    "degree": "deg",
    "degrees": "deg",
    "rev": "turn",
    "U": "turn",
    "1/s": "Hz",
    "rev/s": "Hz",
    "RPM": "rpm",
    "1/min": "rpm",
    "min-1": "rpm",
    "min^-1": "rpm",
    "U/min": "rpm",
    "rev/min": "rpm",
    "r/min": "rpm",
    "rads/s": "rad/s",
    "rad*s^-1": "rad/s",
    "°/s": "deg/s",
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
            f"{where}: unit {text!r} came{did_you_mean(text, spellings)}; give one of "
            f"{', '.join(UNITS)}, and scale for what is left."
        )
    return UNITS[name]
