"""The command line.

Exit status 0 done, 1 the data cannot answer, 2 bad input, 70 a failure of penode, 130 stopped.
"""

import gc
import sys
from importlib.metadata import version
from typing import Annotated, Any

import typer
from rich.console import Console
from typer.core import TyperGroup

from penode.cli.check import check_command
from penode.cli.compare import compare_command
from penode.cli.compilation_cache import use_compilation_cache
from penode.cli.demo import demo_command
from penode.cli.export import export_command
from penode.cli.identify import identify_command
from penode.cli.init import init_command
from penode.cli.last_resort import FAILED, Notes, of_memory, of_penode, of_the_system
from penode.cli.loci import loci_command
from penode.cli.lost_interrupt import raise_lost_interrupts
from penode.cli.progress import Interrupted
from penode.cli.report import report_command
from penode.cli.reproduce import reproduce_command
from penode.cli.simulate import simulate_command
from penode.cli.streams import flush_output, use_tolerant_streams
from penode.cli.sweep import sweep_command
from penode.errors import InputError
from penode.fit.left_out import LOG


class _Commands(TyperGroup):
    """The commands; wrong usage is refused as other input is, and Ctrl-C has a sentence."""

    def main(self, *args: Any, **settings: Any) -> Any:
        try:
            status = super().main(*args, **{**settings, "standalone_mode": False})
        except Exception as error:
            if not hasattr(error, "format_message"):
                raise
            raise _usage(error) from error
        sys.exit(status)

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise Interrupted("Stopped; what was not finished is not written.") from error


app = typer.Typer(
    cls=_Commands,
    help="Identify the flux-linkage map and the resistance of a PMSM from an ordinary recording.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"penode {version('penode')}")
        raise typer.Exit


@app.callback()
def _every_command(
    wanted: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_say_version),
    ] = False,
) -> None: ...


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
app.command("sweep")(sweep_command)
app.command("reproduce")(reproduce_command)


def _usage(error: Any) -> BaseException:
    """Return the refusal of wrong usage; the page of help that `penode` alone shows is none."""
    message = error.format_message().strip()
    if "\n" in message:
        error.show()
        return SystemExit(error.exit_code)
    message = message.replace(". Did you mean", ", did you mean").rstrip(".?")
    page = error.ctx.command_path if error.ctx is not None else "penode"
    return InputError(f"{message[:1].lower()}{message[1:]}; see {page} --help.")


#: New objects between two searches for garbage.
_GARBAGE = 100_000
_NOTES = Notes()


def main() -> None:
    """Run the command line; bad input is refused in one sentence."""
    # Modules and compiled programs stay to the end; to search them again and again is 3 % of a fit.
    gc.freeze()
    gc.set_threshold(_GARBAGE, 10, 10)
    use_compilation_cache()
    use_tolerant_streams()
    raise_lost_interrupts()
    LOG.addHandler(_NOTES)  # again is as once
    try:
        try:
            app(prog_name="penode")
        finally:
            flush_output()
    except InputError as error:
        _say(f"error: {error}")
        sys.exit(2)
    except Interrupted as stop:
        _say(str(stop))
        sys.exit(130)
    except OSError as error:
        _say(f"error: {of_the_system(error)}")
        sys.exit(2)
    except MemoryError as error:
        _say(f"error: {of_memory(error)}")
        sys.exit(2)
    except Exception as error:
        _say(f"error: {of_penode(error)}")
        sys.exit(FAILED)


def _say(text: str) -> None:
    Console(stderr=True).print(text, soft_wrap=True, highlight=False, markup=False)
