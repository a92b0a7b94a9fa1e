"""The command ``penode loci``."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import typer

from penode.arrays import FloatArray
from penode.cli.console import Row, print_rows
from penode.cli.fits import end_unless_answered, load_machine, require_same_pole_pairs
from penode.cli.options import require_png, require_suffix
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.control.controlled_machine import (
    ControlledMachine,
    largest_current,
    voltage_limit_of,
)
from penode.pmsm.control.loci import (
    BEYOND,
    ControlLoci,
    Locus,
    backed_current,
    control_loci,
    loci_csv,
    supported_torques,
)
from penode.pmsm.control.operating_points import OperatingPoints, operating_points
from penode.report.quantities import number

#: Points of an axis of the table, and the most of them.
_POINTS, _MOST = 21, 1001
_UNSUPPORTED = ", beyond the recordings"


def loci_command(  # noqa: PLR0913 (an argument an option)
    folder: Path,
    i_max: float | None,
    out: Path | None,
    u_max: float | None,
    pole_pairs: int | None,
    csv: Path | None,
    table: Path | None,
    torque: str | None,
    speed: str | None,
    as_json: bool,
    trust: bool,
) -> None:
    """Compute what a controller needs: MTPA, MTPV, torque over speed, and currents over both."""
    require_png(out)
    require_suffix(csv, ".csv")
    require_suffix(table, ".csv")
    _require_table(table, torque, speed)
    fit = load_machine(folder, trust)
    require_same_pole_pairs(fit, pole_pairs)
    machine = ControlledMachine.of(fit, pole_pairs)
    largest = largest_current(fit)
    _require_near(i_max, largest)
    backed = backed_current(machine, largest)
    volts = voltage_limit_of(fit) if u_max is None else u_max
    loci = control_loci(machine, backed if i_max is None else i_max, volts)
    points = _points(machine, loci, torque, speed) if table is not None else None
    files: list[Row] = []
    if out is not None:
        # Imported here: the plotting library takes a third of a second, and few commands draw.
        from penode.pmsm.control.loci_picture import loci_picture

        write_atomically(out, loci_picture(machine, loci, str(folder)))
        files.append(("picture", str(out)))
    if csv is not None:
        write_atomically(csv, loci_csv(loci))
        files.append(("loci", str(csv)))
    if table is not None and points is not None:
        write_atomically(table, points.csv())
        reached, known = (int(np.sum(one)) for one in (points.reached, points.supported))
        shown = f"{reached} of {points.reached.size} points reached, {known} of them supported"
        files.append(("table", f"{table}: {shown}"))
    if as_json:
        paths = {"picture": out and str(out), "table": table and str(table)}
        typer.echo(json.dumps({**_as_json(loci), **paths}))
    else:
        limits = _limits(backed if i_max is None else None, volts, u_max is None)
        nothing = [("note", "nothing is drawn or written without --out, --csv or --table")]
        print_rows([*limits, *_figures(loci, largest), *(files or nothing)])
    end_unless_answered(fit)


def _limits(backed: float | None, volts: float | None, recorded: bool) -> list[Row]:
    """Return the limits that nobody gave: a current in A, a voltage in V that was recorded."""
    found: list[Row] = []
    if backed is not None:
        limit = f"{number(backed)} A, as far as recordings back MTPA; --i-max gives another"
        found.append(("current limit", limit))
    if volts is None:
        found.append(("voltage limit", "not known: torque over speed needs --u-max"))
    elif recorded:
        limit = f"{number(volts)} V, u_dc / sqrt(3); --u-max gives another"
        found.append(("voltage limit", limit))
    return found


def _require_near(i_max: float | None, largest: float) -> None:
    """Refuse a current limit far beyond the largest recorded current, both A."""
    if i_max is not None and i_max > BEYOND * largest:
        raise InputError(
            f"--i-max must be at most {number(BEYOND * largest)} A, {BEYOND} times the largest "
            f"current that was recorded, got {number(i_max)} A; record larger currents."
        )


def _require_table(table: Path | None, torque: str | None, speed: str | None) -> None:
    """Refuse axes of a table that is not written."""
    if table is None and (torque or speed):
        raise InputError("--torque and --speed must be given with --table, got no --table; add it.")


def _points(
    machine: ControlledMachine, loci: ControlLoci, torque: str | None, speed: str | None
) -> OperatingPoints:
    """Return the table asked for, by default up to the most torque and twice the base speed."""
    if loci.voltage_limit is None or loci.over_speed is None:
        raise InputError(
            "a voltage limit must be known for currents over the speed, got none, and u_dc was "
            "not recorded; set --u-max."
        )
    most = float(loci.mtpa.torque.max())
    torques = np.linspace(0, most, _POINTS) if torque is None else _axis("--torque", torque)
    fastest = 0.0 if loci.over_speed.speed is None else float(loci.over_speed.speed.max())
    step = min(fastest, 2 * (loci.base_speed or np.inf)) * 30 / np.pi / (_POINTS - 1)
    # Two digits: what nobody gave is a speed that people set.
    speeds = np.arange(_POINTS) * float(f"{step:.1e}") * np.pi / 30
    if speed is not None:
        speeds = _axis("--speed", speed) * np.pi / 30
    return operating_points(machine, torques, speeds, loci.current_limit, loci.voltage_limit)


def _axis(option: str, text: str) -> FloatArray:
    """Return evenly spaced values of ``lowest:highest:points``."""
    try:
        low, high, points = text.split(":")
        ends, count = (float(low), float(high)), int(points)
        if not (np.isfinite(ends).all() and ends[0] < ends[1] and 2 <= count <= _MOST):
            raise ValueError
    except ValueError as error:
        raise InputError(
            f"{option} must be lowest:highest:points, with 2 to {_MOST} points, such as "
            f"0:200:21, got {text!r}."
        ) from error
    return np.linspace(*ends, count)


def _figures(loci: ControlLoci, largest: float) -> list[Row]:
    """Return the main figures; extrapolations from the largest recorded current, A, are marked."""
    short, mtpv = loci.characteristic, loci.mtpv
    found = float(np.hypot(*short.current)[0])
    current = f"{number(found)} A"
    if not found <= BEYOND * largest:
        current = f"more than {number(BEYOND * largest)} A"
    rows: list[Row] = [
        ("MTPA", _end_of(loci.mtpa)),
        ("characteristic current", current + ("" if short.supported[0] else _UNSUPPORTED)),
        ("MTPV", f"up to {_end_of(mtpv)}" if mtpv.torque.size else "not within the current limit"),
    ]
    if loci.base_speed is not None and loci.over_speed is not None:
        rows.append(("base speed", f"{number(loci.base_speed * 30 / np.pi, 4)} rpm of the shaft"))
    every = [loci.mtpa, loci.mtpv, *([loci.over_speed] if loci.over_speed else [])]
    supported = np.concatenate([one.supported for one in every])
    if not supported.all():
        outside = f"{np.count_nonzero(~supported)} of {len(supported)} points"
        rows.append(("note", f"{outside} of the loci lie where no recording has been"))
    return rows


def _end_of(locus: Locus) -> str:
    """Return the torque and current at the end of a locus, and where recordings support it."""
    i_d, i_q = locus.current[:, -1]
    most = f"{number(locus.torque[-1])} Nm at i_d {number(i_d)} A, i_q {number(i_q)} A"
    if locus.supported.all():
        return most
    if not locus.supported.any():
        return most + _UNSUPPORTED
    ranges = supported_torques(locus.torque, locus.supported)
    return f"{most}; motoring, recordings support {ranges} Nm"


def _as_json(loci: ControlLoci) -> dict[str, Any]:
    """Return the main figures in SI units, the speed in rpm; None where there is none."""
    speed = None if loci.base_speed is None else loci.base_speed * 30 / np.pi
    return {
        "mtpa": _last(loci.mtpa),
        "mtpv": _last(loci.mtpv),
        "characteristic": _last(loci.characteristic),
        "base_speed_rpm": speed,
    }


def _last(locus: Locus) -> dict[str, float | bool] | None:
    """Return the operating point at the end of a locus."""
    if not locus.torque.size or not np.isfinite(locus.current[:, -1]).all():
        return None
    i_d, i_q = map(float, locus.current[:, -1])
    torque = float(locus.torque[-1])
    return {"i_d": i_d, "i_q": i_q, "torque": torque, "supported": bool(locus.supported[-1])}
