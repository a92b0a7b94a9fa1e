"""`penode init`: begin a study file with what a recording shows of itself."""

from pathlib import Path

from penode.cli.console import Row, print_rows
from penode.data.load import read
from penode.data.table import TIME, list_names
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.machine.flux_grid import is_map
from penode.pmsm.machine.terms import SPEED
from penode.pmsm.recording.drive_mapping import TIME_STEP
from penode.pmsm.recording.guess import StudyGuess, at_standstill, guess_study
from penode.pmsm.recording.study_text import study_text


def init_command(
    recording: Path,
    out: Path,
    standstill: bool,
) -> None:
    """Write a study file with the best guesses from a recording, each with its reason."""
    if out.exists() and recording.exists():
        raise InputError(f"{out}: this file exists; remove it, or give another name with --out.")
    if is_map(recording):
        raise InputError(
            f"{recording}: must be a recording, got the table of a flux map; compare it with a "
            f"result: penode compare RESULT {recording}."
        )
    table, _ = read(recording)
    guess = guess_study(table)
    if standstill:
        guess = at_standstill(guess, table, str(recording))
    write_atomically(out, study_text(guess, str(recording), str(out)))
    rows: list[Row] = [("study", str(out))]
    for name, channel in guess.channels.items():
        signed = f"{'-' if channel.sign < 0 else ''}{channel.column} in {channel.unit}"
        rows.append((name, signed + (", mechanical" if channel.mechanical else "")))
    rows += [(name, f"{value:g}, a number") for name, value in guess.numbers.items()]
    if guess.time_step is not None:
        rows.append((TIME_STEP, "{}, {:.6g} s".format(*guess.time_step)))
    if guess.unused:
        rows.append(("not used", list_names(guess.unused)))
    print_rows([*rows, ("note", _open_questions(guess))])


def _open_questions(guess: StudyGuess) -> str:
    """Say what a person has to fill in, or only to look at."""
    timeless = guess.missing == (TIME,) and not guess.counter
    missing = [f"column of {name}" for name in guess.missing if not timeless and name != TIME]
    if TIME in guess.missing and not timeless:
        counted = f"{TIME_STEP} ({guess.counter} counts samples)"
        missing.insert(0, counted if guess.counter else f"column of {TIME} or {TIME_STEP}")
    missing += [f"{TIME_STEP} ({TIME} jitters or repeats)"] * guess.uneven
    missing += ["pole_pairs"] * guess.lacks_pole_pairs
    missing += guess.bases
    if timeless:
        first = f" Fill in before you use it: {', '.join(missing)}." if missing else ""
        return (
            "No column of time: penode identify takes it as a table of operating points; for a "
            f"recording fill in {TIME_STEP}, or the column of {TIME}.{first}"
        )
    if missing:
        still = (
            " Did the rotor stand still? Then add --standstill."
            if SPEED.name in guess.missing
            else ""
        )
        rest = "The rest is guessed: look at it before you trust a result."
        return f"Fill in before you use it: {', '.join(missing)}.{still} {rest}"
    return "All of this is guessed; the file says from what. Look at it before you trust a result."
