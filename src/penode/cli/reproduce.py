"""The command ``penode reproduce``."""

from collections.abc import Mapping
from typing import Annotated, Any

import typer
from rich.status import Status

from penode.cli.console import ERRORS, Interrupted, Row, print_rows, say
from penode.cli.options import OutFolder


def reproduce_command(
    study: Annotated[str, typer.Argument(help="all, or the name of one study.")],
    out: OutFolder,
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
