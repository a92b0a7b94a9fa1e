"""What the name of a column says: quantity, axis, unit, shaft or electrical, measured or asked for.

English and German names are read, such as ``id_A``, ``Iq_meas``, ``ud_ref``, ``Strom_d``,
``Spannung q``, ``n_mech``, ``Drehzahl [1/min]``, ``omegaEl``, ``theta``, ``i_U``, ``u_alpha``,
``V_UV``, ``duty_a``, ``Udc``, ``idmeas``, ``Udref``, ``Uqs``, ``TempMagnet``; so are the names that
VESC (``d_axis_current``, ``erpm``), ODrive (``foc.Vd_setpoint``, ``phase_vel``), moteus
(``servo_stats.d_A``) and TI's motor control (``Idq_in_A.value[0]``) give.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from penode.data.units import unit_name

_CURRENT, _VOLTAGE, _DUTY, _SPEED, _ANGLE = "i", "u", "duty", "omega_el", "theta_el"
# Whole words, and parts of words that are long enough not to be something else.
_WORDS = {
    _CURRENT: {"i", "is", "curr", "amps"},
    _VOLTAGE: {"u", "v", "us", "vs", "volt"},
    _DUTY: {"pwm", "mod"},
    _SPEED: {
        "n",
        "w",
        "om",
        "rpm",
        "nmech",
        "nm",
        "wm",
        "wmech",
        "wel",
        "we",
        "omegae",
        "erpm",
        "vel",
    },
    _ANGLE: {"pos", "phi", "gamma", "eps", "epsilon", "rho", "th", "thetae"},
}
_PARTS = {
    _CURRENT: ("strom", "current"),
    _VOLTAGE: ("spannung", "voltage"),
    _DUTY: ("duty", "tastgrad", "tastverh", "aussteuer", "modulation"),
    _SPEED: ("drehzahl", "speed", "omega", "velocity", "frequency"),
    _ANGLE: ("theta", "winkel", "angle", "position", "lage"),
}
_TIME = {"t", "time", "zeit", "times", "timestamp", "stamp"}
_AXES = {
    **{axis: axis for axis in "dqabc"},
    **{
        "sd": "d",
        "sq": "q",
        "ds": "d",
        "qs": "q",
        "u": "a",
        "v": "b",
        "w": "c",
        "1": "a",
        "2": "b",
        "3": "c",
    },
    **{"alpha": "alpha", "al": "alpha", "beta": "beta", "be": "beta"},
    **{"ab": "ab", "bc": "bc", "ca": "ca", "uv": "ab", "vw": "bc", "wu": "ca"},
}
_LINES = {"ab", "bc", "ca"}
# Words of the DC link, in the name of a voltage.
_LINK_WORDS = {"dc", "zk", "bus", "link", "udc", "vdc", "uzk", "vbus", "ubus"}
_JOINED = re.compile(r"(i|is|u|us|v|vs)([dqabcuvw]|s[dq]|[dq]s|alpha|beta|ab|bc|ca|uv|vw|wu)")
_LONE_DUTY = re.compile(r"d [abc123]")
_SIDES = {
    "mechanical": ("mech", "shaft", "welle", "nmech", "nm", "wm", "wmech", "m"),
    "electrical": (
        "el",
        "elec",
        "elek",
        "electric",
        "wel",
        "we",
        "omegae",
        "thetae",
        "erpm",
        "phase",
        "e",
    ),
}
_ASKED = {"ref", "soll", "set", "cmd", "command", "target", "setpoint", "desired", "des", "star"}
_MEASURED = {"meas", "measured", "act", "actual", "ist", "mess", "fb", "sens"}
# Such a word, written on to a short name: idmeas, Udref, nist.
_GLUED = re.compile(
    rf"({_JOINED.pattern}|n|w|omega|theta|udc)({'|'.join(sorted(_ASKED | _MEASURED))})"
)
# Temperatures: what their names begin with, and whose they are.
_TEMPERATURE = re.compile(r"t|temp.*|.*temperatur(e|en)?")
_HEATED = {
    "winding_temperature": ("winding", "wicklung", "wdg", "stator", "coil", "copper", "kupfer"),
    "magnet_temperature": ("magnet",),
}
_TORQUE = ("torque", "drehmoment")
_OTHER = ("temp", "moment", "power", "leistung", "limit", "error", "fault", "status")
_OTHER_WORDS = {"max", "min", "flag", "idc", "rms", "eff"}

# Two axes as one array: Idq_in_A.value[0], Vdq_out_V.value[1]; an axis that its unit says more of.
_ARRAY = re.compile(r"(.*?)([iuv])dq(\w*)\.value\[([01])\]", re.IGNORECASE)
_OF_TORQUE = ("Nm", "mNm")
_OF_UNIT = {"A": _CURRENT, "V": _VOLTAGE}

# Numbers that are a time step in s, those that are one over it, and the shortest in s.
_STEPS = {"ts", "dt", "tsample", "sampletime", "samplingtime", "timestep", "tstep", "stepsize"}
_RATES = {"fs", "fsample", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency"}
_SHORTEST = 1e-7

# Splits camel case and digits: IqMeas, omegaEl, I1, IDRef.
_TOKEN = re.compile(r"[A-Z]+(?![a-zäöü])|[A-ZÄÖÜ]?[a-zäöü]+|\d+")


@dataclass(frozen=True)
class NameHint:
    """What the name of a column says: channel, unit (empty without), side of a speed or angle.

    ``channel`` is a key of `penode.pmsm.recording.drive_mapping.MAPPED`, ``unit`` one of
    `penode.data.units.UNITS`; ``asked_for`` marks a reference, not a measurement.
    """

    channel: str
    unit: str
    side: str
    asked_for: bool


def read_name(column: str) -> NameHint | None:
    """Read the name of a column; None where it is that of no channel.

    Of ``struct.field`` and ``group/name`` the last part counts.
    """
    array = _ARRAY.fullmatch(column)
    if array:
        column = f"{array[2]}{'dq'[int(array[4])]}{array[3]}"
    bare, unit = split_unit(column)
    # A last letter may be an axis, not a unit: in i_A and u_V it alone names the phase.
    for name, its_unit in ((bare, unit), (column, "")):
        found = (token.lower() for token in _TOKEN.findall(re.split(r"[./]", name)[-1]))
        tokens = [part for token in found for part in _apart(token)]
        if tokens in (["d"], ["q"]) and its_unit in _OF_UNIT:
            tokens = [_OF_UNIT[its_unit], *tokens]
        lone_phase = tokens == ["phase"] and its_unit not in _OF_UNIT
        channel = _ANGLE if lone_phase else _channel(tokens)
        if its_unit in _OF_TORQUE or any(part in token for token in tokens for part in _TORQUE):
            channel = None if _OTHER_WORDS & set(tokens) else "torque"
        if channel is not None:
            asked_for = bool(_ASKED & set(tokens)) or name.endswith("*")
            return NameHint(channel, its_unit, _side(tokens, channel), asked_for)
    return None


def time_step_of(numbers: Mapping[str, float]) -> tuple[str, float] | None:
    """Return the number that is the time from one sample to the next, and the s it stands for."""
    for name, value in numbers.items():
        last = re.sub(r"[^a-z]", "", re.split(r"[./]", name.lower())[-1])
        step = 1.0 / value if last in _RATES and value > 0 else value if last in _STEPS else 0.0
        if _SHORTEST <= step <= 1.0:
            return name, step
    return None


def split_unit(column: str) -> tuple[str, str]:
    """Split ``Id [A]``, ``id_A`` and ``speed_in_rpm`` into name and unit."""
    bracketed = re.fullmatch(r"(.+?)[\s_]*[\[(]([^\])]*)[\])]\s*", column)
    if bracketed:
        return bracketed[1], unit_name(bracketed[2]) or ""
    ending = re.fullmatch(r"(.+?)(?:_in_|_|\s+in\s+|\s+)([^\s_]+)", column)
    if ending and unit_name(ending[2]):
        return ending[1], unit_name(ending[2]) or ""
    return column, ""


def _apart(token: str) -> tuple[str, ...]:
    """Return a word, and apart from it what says whether it was measured or asked for."""
    glued = _GLUED.fullmatch(token)
    return (token,) if glued is None else (glued[1], glued[glued.lastindex or 1])


def _channel(tokens: list[str]) -> str | None:
    if tokens and set(tokens) <= _TIME:
        return "t"
    if any(_TEMPERATURE.fullmatch(token) for token in tokens):
        return _of_heat("".join(tokens))
    other = any(part in token for token in tokens for part in _OTHER)
    if not tokens or other or _OTHER_WORDS & set(tokens):
        return None
    if _LONE_DUTY.fullmatch(" ".join(tokens)):
        return _with_axis(_DUTY, tokens[1:])
    if _LINK_WORDS & set(tokens) or any("zwischenkreis" in token for token in tokens):
        return _of_link(tokens)
    return _with_quantity(tokens)


def _with_quantity(tokens: list[str]) -> str | None:
    """Return the channel of the first quantity that is named."""
    for place, token in enumerate(tokens):
        joined = _JOINED.fullmatch(token)
        if joined:
            return _with_axis(_CURRENT if joined[1][0] == "i" else _VOLTAGE, [joined[2]])
        quantity = _quantity(token)
        if quantity in (_CURRENT, _VOLTAGE, _DUTY):
            return _with_axis(quantity, [*tokens[place + 1 :], *tokens[:place]])
        if quantity:
            return quantity
    return None


def _of_heat(name: str) -> str | None:
    """Return the channel of a temperature, None where it is that of something else, as oil."""
    whose = (ch for ch, words in _HEATED.items() if any(word in name for word in words))
    return next(whose, None)


def _with_axis(quantity: str, tokens: list[str]) -> str | None:
    """Return the channel of a quantity along the first axis that is named, if it has that axis."""
    axis = next((_AXES[token] for token in tokens if token in _AXES), None)
    allowed = axis is not None and (quantity, axis in _LINES) != (_CURRENT, True)
    if quantity == _DUTY:
        allowed = axis in ("a", "b", "c")
    return f"{quantity}_{axis}" if allowed else None


def _of_link(tokens: list[str]) -> str | None:
    """Return the channel of the DC link where it is its voltage."""
    joined = _LINK_WORDS - {"dc", "zk", "bus", "link"}
    voltage = any(_quantity(token) == _VOLTAGE for token in tokens) or joined & set(tokens)
    return "u_dc" if voltage else None


def _quantity(token: str) -> str | None:
    for quantity, words in _WORDS.items():
        if token in words or any(part in token for part in _PARTS[quantity]):
            return quantity
    return None


def _side(tokens: list[str], channel: str) -> str:
    if channel not in (_SPEED, _ANGLE):
        return ""
    return next((side for side, words in _SIDES.items() if _any_starts(tokens, words)), "")


def _any_starts(tokens: list[str], words: tuple[str, ...]) -> bool:
    return any(
        token == word or (len(word) > 2 and token.startswith(word))
        for token in tokens
        for word in words
    )
