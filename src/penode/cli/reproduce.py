"""The command ``penode reproduce``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.status import Status

from penode.cli.progress import Interrupted

_output, _errors = Console(), Console(stderr=True)


def reproduce_command(
    study: Annotated[str, typer.Argument(help="all, or the name of one study.")],
    out: Annotated[Path, typer.Option(help="Folder for results and runs; made if absent.")],
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="A small part of everything, in a few minutes, to see that it runs."
        ),
    ] = False,
) -> None:
    """Rebuild the paper's experiments on the simulated bench, ours beside them.

    Studies: resistance_vs_horizon, flux_error_vs_horizon, generalisation_vs_horizon,
    testbench_resistance, well_designed, subdomain, solver_dependence, table.

    Every training is kept as it ends. After Ctrl-C the same command goes on.

    Example: penode reproduce all --out studies --quick
    """
    # Imported here: the plotting library takes a third of a second, and few commands draw.
    from penode.paper.studies.reproduce import chosen_studies, reproduce
    from penode.paper.studies.variants import FULL, QUICK

    names = chosen_studies(study)
    try:
        with _errors.status("starting ...") as status:
            extent = QUICK if quick else FULL
            page, results = reproduce(names, out, extent, _say, lambda event: _show(status, event))
    except KeyboardInterrupt as error:
        raise Interrupted(
            "Stopped; finished trainings are kept: the same command goes on."
        ) from error
    for result in results:
        _output.print(f"{result.name:26s} {result.outcome}", soft_wrap=True, highlight=False)
    _output.print(f"page  {page}", soft_wrap=True, highlight=False)


def _say(text: str) -> None:
    _errors.print(text, soft_wrap=True, highlight=False, markup=False)


def _show(status: Status, event: Mapping[str, Any]) -> None:
    if event["event"] == "evaluation":
        status.update(f"H = {event['horizon']}, loss {event['loss']:.4g} A²")
