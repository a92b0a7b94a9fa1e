"""Arguments and options that several commands have, and how their texts are read."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from penode.errors import InputError, require_extra
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.study_file import StudyFile, load_study

_BY_DATA = "decided from the data"
Recordings = Annotated[
    list[Path],
    typer.Argument(help="Recordings: csv, xlsx, parquet, mat, mf4, tdms; with gaps, by stretches."),
]
SavedFit = Annotated[Path, typer.Argument(help="Folder that identify or demo wrote.")]
OutFolder = Annotated[Path, typer.Option(help="Folder for the results; made if absent.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON document instead.")]
Config = Annotated[
    Path | None,
    typer.Option(help="Study file: columns, units, options. penode init writes one."),
]
Configs = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        help="Study file: columns, units, options. penode init writes one. Again for recordings "
        "with other columns: each is read by the first that fits it; all else is the first's.",
    ),
]
FluxMapOption = Annotated[
    str | None,
    typer.Option(
        help=f"One of {', '.join(FLUX_MAPS)}.",
        show_default="coenergy",
        autocompletion=lambda: list(FLUX_MAPS),
    ),
]
Inverter = Annotated[
    bool | None,
    typer.Option(
        help="Dead time and on-state drops of the inverter, in the model or not; needs theta_el.",
        show_default=_BY_DATA,
    ),
]
Terms = Annotated[
    str | None,
    typer.Option(
        help=f"Terms of the voltage equation beside R and rotation, or in place of R: "
        f"{', '.join(TERMS)}. With commas.",
        show_default="resistance; dead_time is decided from the data",
        autocompletion=lambda: list(TERMS),
    ),
]
AngleOrders = Annotated[
    str | None,
    typer.Option(
        help="Harmonics of the angle in the map, such as 6,12, or none; they need theta_el.",
        show_default=_BY_DATA,
    ),
]
HoldOption = Annotated[
    str | None,
    typer.Option(
        help=f"Frame in which the voltage is held: {' or '.join(HOLDS)}.",
        show_default=_BY_DATA,
        autocompletion=lambda: list(HOLDS),
    ),
]
TrustClasses = Annotated[
    bool,
    typer.Option(
        "--trust-classes",
        help="Import the modules of the fit's own classes, which runs them.",
    ),
]


def load_studies(paths: list[Path] | None, changes: Mapping[str, Any]) -> StudyFile:
    """Return what the first study file says, with the columns of all; options override it."""
    if not paths:
        return load_study(None, changes)
    first, others = load_study(paths[0], changes), list[StudyFile]()
    pairs = {name: changes[name] for name in ("pole_pairs",) if name in changes}
    for path in paths[1:]:
        other = load_study(path, pairs)
        if other.study.pole_pairs not in (None, first.study.pole_pairs):
            raise InputError(
                f"{path}: pole_pairs must be those of {paths[0]}, got {other.study.pole_pairs} and "
                f"{first.study.pole_pairs or 'none'}; correct one, or give --pole-pairs."
            )
        others.append(other)
    if not others:
        return first
    of_shaft = dict.fromkeys(name for one in (first, *others) for name in one.study.of_shaft)
    return replace(
        first,
        study=replace(first.study, of_shaft=tuple(of_shaft)),
        mapping=replace(first.mapping, others=tuple(one.mapping for one in others)),
        entries={**first.entries, "others": [dict(one.entries) for one in others]},
    )


def given(**options: Any) -> dict[str, Any]:
    """Return the options that were given, which override a study file; harmonics as numbers."""
    came = {name: option for name, option in options.items() if option is not None}
    if "terms" in came:
        came["terms"] = [name.strip() for name in came["terms"].split(",")]
    if "angle_orders" in came:
        text = came["angle_orders"]
        came["angle_orders"] = () if text in ("", "none") else whole_numbers("angle-orders", text)
    return came


def whole_numbers(option: str, text: str) -> tuple[int, ...]:
    """Return numbers with commas between them; refuse what is no whole number."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        none = "none, or " if option == "angle-orders" else ""
        raise InputError(
            f"--{option} must be {none}whole numbers with commas, such as 6,12, got {text}."
        ) from error


def require_suffix(path: Path | None, suffix: str) -> None:
    """Refuse the name of a file to write that has another suffix."""
    if path is not None and path.suffix.lower() != suffix:
        raise InputError(f"{path}: the suffix must be {suffix}, got {path.suffix!r}; use {suffix}.")


def require_png(*pictures: Path | None) -> None:
    """Refuse pictures of another suffix, and any where the library that draws is missing."""
    for path in pictures:
        require_suffix(path, ".png")
        if path is not None:
            require_extra("matplotlib", "plot", f"{path}: a picture")
