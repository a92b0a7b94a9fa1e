"""Arguments and options that several commands have, and how their texts are read."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from penode.errors import InputError, require_extra
from penode.pmsm.study_file import StudyFile, load_study


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
