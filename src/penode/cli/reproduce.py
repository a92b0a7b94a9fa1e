"""The command ``penode reproduce``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.status import Status

from penode.cli.console import ERRORS, Interrupted, Row, print_rows, say


def reproduce_command(
    study: str,
    out: Path,
    quick: bool,
) -> None:
    """Rebuild the paper's experiments on the simulated bench, ours beside them."""
    # Imported here: the plotting library takes a third of a second, and few commands draw.
    from penode.paper.studies.reproduce import chosen_studies, reproduce
    from penode.paper.studies.variants import FULL, QUICK

    names = chosen_studies(study)
    try:
        with ERRORS.status("starting ...") as status:
            extent = QUICK if quick else FULL
            page, results = reproduce(names, out, extent, say, lambda event: _show(status, event))
    except KeyboardInterrupt as error:
        raise Interrupted(
            "Stopped; finished trainings are kept: the same command goes on."
        ) from error
    rows: list[Row] = [(result.name, result.outcome) for result in results]
    print_rows([*rows, ("page", str(page))])


def _show(status: Status, event: Mapping[str, Any]) -> None:
    if event["event"] == "evaluation":
        status.update(f"H = {event['horizon']}, loss {event['loss']:.4g} A²")
