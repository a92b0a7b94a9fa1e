"""The command ``penode loci``."""

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from penode.cli.console import Row, print_rows
from penode.cli.fits import load_machine, warn_if_unanswered
from penode.cli.options import Json, SavedFit, TrustClasses, require_png, require_suffix
from penode.fit.archive import write_atomically
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.loci import ControlLoci, Locus, control_loci, loci_csv
from penode.report.quantities import number


def loci_command(  # noqa: PLR0913 (an argument an option)
    folder: SavedFit,
    i_max: Annotated[
        float | None,
        typer.Option(
            help="Current limit in A, peak value of a phase.", show_default="the largest recorded"
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="PNG to write.")] = None,
    u_max: Annotated[
        float | None, typer.Option(help="Voltage limit in V, peak of a phase: u_dc / sqrt(3).")
    ] = None,
    pole_pairs: Annotated[int | None, typer.Option(help="Of the machine.")] = None,
    csv: Annotated[Path | None, typer.Option(help="CSV of the loci to write as well.")] = None,
    as_json: Json = False,
    trust: TrustClasses = False,
) -> None:
    """Compute what a controller needs: MTPA, MTPV, and most torque over speed with --u-max.

    Example: penode loci result --pole-pairs 5

    Example: penode loci result --i-max 240 --u-max 230 --pole-pairs 5 --out loci.png
    """
    require_png(out)
    require_suffix(csv, ".csv")
    fit = load_machine(folder, trust)
    machine = ControlledMachine.of(fit, pole_pairs)
    recorded = float(np.hypot(*fit.excited.T).max())
    loci = control_loci(machine, recorded if i_max is None else i_max, u_max)
    files: list[Row] = []
    if out is not None:
        # Imported here: the plotting library takes a third of a second, and few commands draw.
        from penode.pmsm.control.loci_picture import loci_picture

        write_atomically(out, loci_picture(machine, loci, str(folder)))
        files.append(("picture", str(out)))
    if csv is not None:
        write_atomically(csv, loci_csv(loci))
        files.append(("loci", str(csv)))
    if as_json:
        typer.echo(json.dumps({**_as_json(loci), "picture": out and str(out)}))
    else:
        limit = f"{number(recorded)} A, the largest recorded; --i-max gives another"
        told: list[Row] = [] if i_max is not None else [("current limit", limit)]
        print_rows([*told, *_figures(loci), *files])
    warn_if_unanswered(fit)


def _figures(loci: ControlLoci) -> list[Row]:
    """Return the main figures; extrapolations are marked."""
    full, short = loci.mtpa, loci.characteristic
    (i_d, i_q), torque = full.current[:, -1], full.torque[-1]
    beyond = ", beyond the recordings"
    most = f"{number(torque)} Nm at i_d {number(i_d)} A, i_q {number(i_q)} A"
    current = f"{number(float(np.hypot(*short.current)[0]))} A"
    rows: list[Row] = [
        ("MTPA", most + ("" if full.supported[-1] else beyond)),
        ("characteristic", current + ("" if short.supported[0] else beyond)),
    ]
    if not loci.mtpv.torque.size:
        rows.append(("MTPV", "not within the current limit"))
    if loci.base_speed is not None and loci.over_speed is not None:
        rows.append(("base speed", f"{number(loci.base_speed * 30 / np.pi, 4)} rpm"))
    every = [loci.mtpa, loci.mtpv, *([loci.over_speed] if loci.over_speed else [])]
    supported = np.concatenate([one.supported for one in every])
    if not supported.all():
        outside = f"{np.count_nonzero(~supported)} of {len(supported)} points"
        rows.append(("note", f"{outside} lie where no recording has been (dashed)"))
    return rows


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
