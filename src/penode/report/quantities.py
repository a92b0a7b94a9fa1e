"""Numbers as people read them: SI prefixes, and digits that follow the uncertainty."""

import math
import re
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike

_SYMBOLS = {"ohm": "Ω", "Ohm": "Ω", "deg": "°"}
_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
# fmt: off
_TAKES_PREFIX = frozenset({
    "A", "C", "F", "H", "Hz", "J", "K", "N", "Nm", "Ohm", "Pa", "S", "T", "V", "Vs", "W", "Wb",
    "g", "m", "ohm", "rad", "s", "Ω",
})
# fmt: on


@dataclass(frozen=True)
class Scale:
    """A unit (``"mΩ"``) whose prefix makes given numbers legible: SI values times the factor."""

    factor: float
    unit: str


def scale_for(values: ArrayLike, unit: str) -> Scale:
    """Choose the SI prefix under which the largest finite value is between 1 and 1000.

    Units that take no prefix (``"1/s"``, ``"rad/s"``, none) keep factor 1.
    """
    symbol = _SYMBOLS.get(unit, unit)
    sizes = np.abs(np.asarray(values, dtype=np.float64)).ravel()
    sizes = sizes[np.isfinite(sizes)]
    largest = float(sizes.max()) if sizes.size else 0.0
    if largest == 0.0 or not takes_prefix(unit):
        return Scale(1.0, symbol)
    exponent = 3 * math.floor(math.log10(largest * (1 + 1e-12)) / 3)
    exponent = min(max(exponent, min(_PREFIXES)), max(_PREFIXES))
    return Scale(10.0**-exponent, _PREFIXES[exponent] + symbol)


def takes_prefix(unit: str) -> bool:
    """Return whether an SI unit is written with prefixes: ``"V"``, and not ``"rad/s"``."""
    return unit in _TAKES_PREFIX


def decimals_for(std: float, value: float) -> int:
    """Return how many decimals, 0 to 9, give the uncertainty two significant digits.

    Both numbers are in the unit shown; a deviation of zero or not finite gives the value four
    digits.
    """
    if math.isfinite(std) and std > 0:
        decimals = 1 - math.floor(math.log10(std))
    elif math.isfinite(value) and value != 0:
        decimals = 3 - math.floor(math.log10(abs(value)))
    else:
        decimals = 0
    return min(max(decimals, 0), 9)


def with_deviation(value: float, std: float) -> tuple[str, str]:
    """Return both with the digits that the deviation gives."""
    decimals = decimals_for(std, value)
    return fixed(value, decimals), fixed(std, decimals)


def number(value: float | None, digits: int = 3) -> str:
    """Format a number to significant digits, without exponent where that stays short.

    None and NaN become a dash, infinities the sign for them; a minus is a true minus sign.
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}".replace("-", "−")
    rounded = abs(float(f"{value:.{digits - 1}e}"))  # 9.996 has the magnitude of 10.0
    magnitude = math.floor(math.log10(rounded)) if value else 0
    return fixed(value, max(digits - 1 - magnitude, 0))


def fixed(value: float, decimals: int) -> str:
    """Format a number to a number of decimals; NaN, infinities and minus as in `number`."""
    if not math.isfinite(value):
        return number(value)
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−") if float(text) else text.removeprefix("-")


def with_unit(value: float | None, unit: str, digits: int = 3) -> str:
    """Format a value in an SI unit with its prefix: ``"10.0 mΩ"``, joined by a no-break space."""
    if value is None or not math.isfinite(value):
        return number(value)
    scale = scale_for(value, unit)
    return f"{number(value * scale.factor, digits)}\N{NO-BREAK SPACE}{scale.unit}".rstrip()


def labelled(name: str, unit: str, space: str = " ") -> str:
    """Return a name with its unit, where it has one: ``"R in mΩ"``."""
    return f"{name} in{space}{unit}" if unit else name


def symbol(name: str) -> str:
    """Return a name as escaped markup, what follows one underscore an index: ``i<sub>d</sub>``."""
    parts = re.fullmatch(r"([A-Za-z]{1,3})_([A-Za-z0-9]{1,4})", name)
    return f"{parts[1]}<sub>{parts[2]}</sub>" if parts else escape(name)
