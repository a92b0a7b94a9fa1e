"""The command line: exit status 0 done, 1 the data cannot answer, 2 bad input, 130 stopped."""

import hashlib
import platform
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import jax
import typer
from rich.console import Console

from penode.cli.check import check_command
from penode.cli.compare import compare_command
from penode.cli.demo import demo_command
from penode.cli.export import export_command
from penode.cli.identify import identify_command
from penode.cli.init import init_command
from penode.cli.loci import loci_command
from penode.cli.progress import Interrupted
from penode.cli.report import report_command
from penode.cli.reproduce import reproduce_command
from penode.cli.simulate import simulate_command
from penode.errors import InputError

app = typer.Typer(
    help="Find the flux-linkage map and the resistance of a PMSM from an ordinary recording.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
# In the order in which a person needs them, which is that of --help.
app.command("demo")(demo_command)
app.command("init")(init_command)
app.command("check")(check_command)
app.command("identify")(identify_command)
app.command("report")(report_command)
app.command("export")(export_command)
app.command("loci")(loci_command)
app.command("compare")(compare_command)
app.command("simulate")(simulate_command)
app.command("reproduce")(reproduce_command)


def main() -> None:
    """Run the command line; bad input is told in one sentence."""
    _use_compilation_cache()
    try:
        app(prog_name="penode")
    except InputError as error:
        _say(f"error: {error}")
        sys.exit(2)
    except Interrupted as stop:
        _say(str(stop))
        sys.exit(130)


def _say(text: str) -> None:
    Console(stderr=True).print(text, soft_wrap=True, highlight=False, markup=False)


def _use_compilation_cache() -> None:
    """Keep compiled programs between runs, apart for each processor; the cache is best effort."""
    with suppress(OSError, ValueError):
        processor = f"{platform.machine()} {platform.processor()} {_processor_flags()}"
        key = hashlib.sha256(f"{processor} {jax.__version__}".encode()).hexdigest()[:16]
        folder = Path.home() / ".cache" / "penode" / "compiled" / key
        folder.mkdir(parents=True, exist_ok=True)
        configure: Callable[[str, object], None] = jax.config.update
        configure("jax_compilation_cache_dir", str(folder))
        configure("jax_persistent_cache_min_compile_time_secs", 0.0)


def _processor_flags() -> str:
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    return next((line for line in lines if line.startswith("flags")), "")
