"""The command ``penode sweep``."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from multiprocessing.connection import wait
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from penode.cli.compilation_cache import use_compilation_cache
from penode.cli.options import (
    AngleOrders,
    Config,
    FluxMapOption,
    HoldOption,
    Inverter,
    Runs,
    Terms,
    given,
    whole_numbers,
)
from penode.cli.progress import Interrupted
from penode.errors import InputError
from penode.fit.result_folder import claimed
from penode.pmsm.study_file import load_study
from penode.pmsm.sweep import Swept, grid_of, sweep, write_sweep
from penode.report.quantities import number, scale_for

_output, _errors = Console(), Console(stderr=True)


def sweep_command(  # noqa: PLR0913 (an argument an option)
    runs: Runs,
    out: Annotated[Path, typer.Option(help="Folder for the results; made if absent.")],
    horizons: Annotated[
        str, typer.Option(help="Steps, with commas between them.")
    ] = "1,2,5,10,20,50,100",
    seeds: Annotated[int, typer.Option(help="Seeds at each horizon.")] = 3,
    config: Config = None,
    flux_map: FluxMapOption = None,
    inverter: Inverter = None,
    terms: Terms = None,
    angle_orders: AngleOrders = None,
    hold: HoldOption = None,
    jobs: Annotated[int, typer.Option(help="Processes side by side.")] = 1,
    dask: Annotated[
        str | None, typer.Option(help="Scheduler of a dask cluster to train on, host:port.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the fits that --out has already.")
    ] = False,
) -> None:
    """Identify independently at every horizon from every seed, to see what depends on them.

    Writes sweep.csv, sweep.png and every fit, which penode report and penode export take. That
    seeds agree says nothing of their value being right: look at how it moves with the horizon.

    Ctrl-C stops; finished fits stay, and the same command with --resume added goes on.

    Example: penode sweep run.csv --horizons 1,10,100 --seeds 3 --out sweep
    """
    options = given(
        flux_map=flux_map, inverter=inverter, terms=terms, angle_orders=angle_orders, hold=hold
    )
    asked = load_study(config, options)
    grid = grid_of(whole_numbers("horizons", horizons), seeds)
    recordings = [asked.load(run) for run in runs]
    swept = []
    try:
        with claimed(out):
            with _workers(jobs, dask) as executor:
                for one in sweep(recordings, asked.study, grid, out, executor, resume):
                    _report(one)
                    swept.append(one)
            swept.sort(key=lambda one: grid.index((one.horizon, one.seed)))
            write_sweep(swept, out)
    except KeyboardInterrupt as error:
        message = "Stopped; finished fits are kept. Add --resume to go on."
        raise Interrupted(message) from error
    _print_table(swept)
    _output.print(f"table   {out / 'sweep.csv'}", soft_wrap=True, highlight=False)
    _output.print(f"figure  {out / 'sweep.png'}", soft_wrap=True, highlight=False)
    if all(one.failure for one in swept):
        raise typer.Exit(1)


@contextmanager
def _workers(jobs: int, dask: str | None) -> Iterator[Executor]:
    """Give processes of this machine or of a cluster; Ctrl-C ends what they do."""
    if dask is not None:
        with _cluster(dask) as executor:
            yield executor
        return
    if jobs < 1:
        raise InputError(f"--jobs {jobs} came; give at least 1.")
    spawned = multiprocessing.get_context("spawn")  # forked, JAX would wait for itself
    with ProcessPoolExecutor(jobs, spawned, _begin) as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.kill()
            raise


def _begin() -> None:
    """Prepare a worker: Ctrl-C is the parent's to handle, and a dead parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    use_compilation_cache()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise InputError(
            "--dask needs the package distributed; install penode[cluster], or use --jobs."
        ) from error
    try:
        client = distributed.Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--dask {address}: no scheduler answers there ({error}).") from error
    with client:
        yield client.get_executor()


def _report(one: Swept) -> None:
    shown = one.failure or ", ".join(
        f"{name} {_shown(value, one.units[name])}" for name, value in one.parameters.items()
    )
    text = f"seed {one.seed}, H = {one.horizon}: {shown}, {one.wall_time:.0f} s"
    _errors.print(text, soft_wrap=True, highlight=False, markup=False)


def _print_table(swept: Sequence[Swept]) -> None:
    """Print a row a horizon: the mean over the seeds, and what they differ by."""
    units = {name: unit for one in swept for name, unit in one.units.items()}
    table = Table(box=None, padding=(0, 2, 0, 0))
    failing = any(one.failure for one in swept)
    for name in ("H", *units, "free run", *(["failed"] if failing else [])):
        table.add_column(name, justify="right")
    for horizon in dict.fromkeys(one.horizon for one in swept):
        here = [one for one in swept if one.horizon == horizon]
        good = [one for one in here if not one.failure]
        cells = [_over_seeds([one.parameters[n] for one in good], u) for n, u in units.items()]
        failed = [str(len(here) - len(good))] if failing else []
        table.add_row(str(horizon), *cells, _free([one.free_run_rmse for one in good]), *failed)
    _output.print(table, highlight=False)


def _over_seeds(values: Sequence[float], unit: str) -> str:
    if not values:
        return "–"
    scale = scale_for(values, unit)
    middle, half = np.mean(values) * scale.factor, np.ptp(values) / 2 * scale.factor
    apart = f" ± {number(float(half), 2)}" if len(values) > 1 else ""
    return f"{number(float(middle), 4)}{apart} {scale.unit}"


def _free(errors: Sequence[float]) -> str:
    """Return the median of free-run errors in A."""
    if not errors:
        return "–"
    middle = float(np.median(errors))
    return f"{number(middle)} A" if np.isfinite(middle) else "diverges"


def _shown(value: float, unit: str) -> str:
    scale = scale_for(value, unit)
    return f"{number(value * scale.factor, 4)} {scale.unit}"
