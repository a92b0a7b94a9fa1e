"""The text of a guessed study file, with the reason for every guess."""

import json

from penode.data.table import TIME
from penode.pmsm.machine.terms import SPEED, TEMPERATURE
from penode.pmsm.recording.channel_guess import ChannelGuess
from penode.pmsm.recording.drive_mapping import BASES, IN_RMS, MAPPED, TIME_STEP
from penode.pmsm.recording.guess import StudyGuess
from penode.pmsm.recording.imperfections import DEFAULT_ACCURACY
from penode.pmsm.recording.stationary_frame import LINK

#: What the numbers of an accuracy are, where they are no fraction of the reading.
_ACCURACY_UNITS = {
    "current_offset": "as a fraction of the largest current",
    "angle": "electrical degrees, of the d axis",
    "delay": "samples, of the voltages",
    "voltage_gain": "as a fraction of the reading; for commands that of u_dc",
}
_HEAD = """\
# Study file, begun by penode init from {recording}. Use it with
#
#   penode identify {recording} --config {study} --out result
#
# What is marked "guess" was guessed: look at it before you trust the result. No recording shows
# whether it holds peak or rms values: add rms = true for the latter. A column that lags by one
# sample takes delay = 1 (-1 for one that leads). Of the voltages parts of a sample are estimated;
# a whole one is named by penode check, or after training, and is entered here.
# A channel may have: column, unit, scale, sign, delay, times, rms, mechanical.

"""
_SETTINGS = """\
flux_map = "coenergy"  # default; or convex, mlp, polynomial, spline
horizon = "auto"  # default; or a number of steps
# Decided from the data unless given here; inverter and angle_orders need theta_el:
# hold = "dq"  # or "stationary": frame in which a voltage seems to stand still for a sample. Leave
#   it out: commands that a controller turns ahead act as held in dq; given here, neither delay nor
#   angle is estimated
# inverter = true  # identify the dead-time voltage
# angle_orders = [6, 12]  # harmonics of the angle in the map; [] for none
# Never decided from the data:
# terms = ["temperature_resistance"]  # R over a recorded winding temperature, if that moves by 5 K
# u_dc = 400  # V, where no column holds it: samples at the limit of voltage are left out by it, and
#   report and loci draw that limit
seed = 0  # default
"""


_NAME_PLATE = """
# What the data sheet says, by which rms is told from peak; of one phase, as warm as recorded:
# [name_plate]
# resistance = 0.01  # ohm
# magnet_flux_linkage = 0.1  # Vs, peak
"""


def study_text(guess: StudyGuess, recording: str, study: str) -> str:
    """Return a study file as text.

    Parameters
    ----------
    guess : StudyGuess
    recording, study : str
        Names of the recording and of the file to be, for the command in its head.

    Returns
    -------
    str
        TOML that `penode.pmsm.study_file.load_study` reads.
    """
    head = _HEAD.format(recording=_on_one_line(recording), study=_on_one_line(study))
    parts = [head, _SETTINGS, _pole_pairs(guess)]
    if guess.resample:
        parts.append(
            "# guess: linear interpolation will do; the channels have different sampling times.\n"
            'resample = "linear"\n'
        )
    parts += [_base(name, unit) for unit, name in BASES.items() if name in guess.bases]
    parts += [
        f"{name} = {value:g}  # the rotor stood still\n" for name, value in guess.numbers.items()
    ]
    if LINK in guess.missing:
        parts.append(
            f"# not found, and needed, as a column or as a number: {LINK} in V.\n# {LINK} =\n"
        )
    parts += _time_step(guess)
    parts.append("\n[channels]\n")
    parts += [_channel(name, channel) for name, channel in guess.channels.items()]
    for name in guess.missing:
        parts.append(f'# not found, and needed: {name} in {MAPPED[name]}.\n# {name} = "..."\n')
        if name == SPEED.name:
            parts.append(f"# Of a rotor that stood still: {name} = 0, above [channels].\n")
    if TEMPERATURE.name not in guess.channels:
        parts += [_of_winding(column, unit) for column, unit in guess.heat.items()]
    parts.append(_NAME_PLATE)
    parts.append(_accuracy())
    if guess.unused:
        parts.append(f"\n# Columns that are not used: {', '.join(map(_quoted, guess.unused))}\n")
    return "".join(parts)


def _accuracy() -> str:
    """Return the accuracies that are assumed, for the user to replace."""
    lines = [
        f"# {name} = {value}  # {_ACCURACY_UNITS.get(name, 'as a fraction of the reading')}\n"
        for name, value in DEFAULT_ACCURACY.declared.items()
    ]
    return "".join(
        ["\n# Standard deviations assumed of your bench; give your own:\n# [accuracy]\n", *lines]
    )


def _pole_pairs(guess: StudyGuess) -> str:
    if guess.pole_pairs is not None:
        return f"pole_pairs = {guess.pole_pairs}  # guess: because speed and angle fit with it\n"
    if guess.lacks_pole_pairs:
        return "# not found, and needed, as a channel is mechanical:\n# pole_pairs =\n"
    return ""


def _time_step(guess: StudyGuess) -> list[str]:
    """Return what is guessed, or to be filled in, of the time from one sample to the next."""
    parts = []
    if guess.time_step is not None:
        called, step = guess.time_step
        parts.append(
            f"{TIME_STEP} = {step:.9g}  # guess: {_on_one_line(called)} of the file, in s\n"
        )
    if TIME in guess.missing:
        counted = f"; {_on_one_line(guess.counter)} counts samples" if guess.counter else ""
        parts.append(
            f"# not found, and needed: the column of {TIME} below, or the time from one sample to "
            f"the next in s{counted}.\n# {TIME_STEP} = 1e-4\n"
        )
    if guess.uneven:
        parts.append(
            f"# {TIME} jitters or repeats. Where a steady clock sampled, the time from one sample "
            f'to the next in s; else resample = "linear".\n# {TIME_STEP} = 1e-4\n'
        )
    return parts


def _base(name: str, unit: str) -> str:
    return (
        f"# not found, and needed: {name}, what 1 is in {unit} of a column per unit.\n# {name} =\n"
    )


def _channel(name: str, guess: ChannelGuess) -> str:
    entries = [f"column = {_quoted(guess.column)}", f"unit = {_quoted(guess.unit)}"]
    if guess.scale != 1.0:
        entries.append(f"scale = {guess.scale:g}")
    if guess.sign < 0:
        entries.append("sign = -1")
    if guess.mechanical:
        entries.append("mechanical = true")
    reasons = [*guess.reasons, *(["peak, as no file shows it"] if name in IN_RMS else [])]
    return f"# guess: {_on_one_line('; '.join(reasons))}.\n{name} = {{ {', '.join(entries)} }}\n"


def _of_winding(column: str, unit: str) -> str:
    return (
        "# A temperature, perhaps of the winding: with it R is said at its temperature.\n"
        f"# {TEMPERATURE.name} = {{ column = {_quoted(column)}, unit = {_quoted(unit)} }}\n"
    )


def _on_one_line(text: str) -> str:
    """Return a text as a TOML comment may hold it: names of columns have breaks in them."""
    return "".join(one if one.isprintable() else " " for one in text)


def _quoted(text: str) -> str:
    """Return a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
