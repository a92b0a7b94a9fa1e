"""The command line.

Exit status 0 done, 1 the data cannot answer, 2 bad input, 70 a failure of penode, 130 stopped.
"""

import gc
import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from penode.cli import commands
from penode.cli.console import Interrupted, Notes, say, why_and_status
from penode.cli.process import flush_output, raise_lost_interrupts, use_tolerant_streams
from penode.errors import InputError
from penode.fit.left_out import LOG
from penode_launcher import undisturbed

#: New objects between two searches for garbage.
_GARBAGE = 100_000


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


def _reflowed(text: str) -> str:
    """Return paragraphs without line ends of their own, which a narrow terminal would keep."""
    return "\n\n".join(" ".join(one.split()) for one in text.split("\n\n"))


def _at_work(typed: Callable[..., None]) -> Callable[..., None]:
    """Return a command that imports what it does when it is to be done, not for a page of help."""
    name = typed.__name__

    @wraps(typed)
    def command(**options: Any) -> None:
        with undisturbed():
            from penode.cli.compilation_cache import use_compilation_cache

            work = getattr(import_module(f"penode.cli.{name}"), f"{name}_command")
            use_compilation_cache()
        # Modules and programs stay to the end; to search them again and again is 3 % of a fit.
        if gc.get_freeze_count():  # garbage of a run before, once frozen, would stay for good
            gc.collect()
        gc.freeze()
        gc.set_threshold(_GARBAGE, 10, 10)
        work(**options)

    return command


# In the order in which a person needs them, which is that of --help.
_NAMES = "demo init check identify report export loci compare simulate sweep reproduce"
for _name in _NAMES.split():
    _typed = getattr(commands, _name)
    app.command(_name, help=_reflowed(_typed.__doc__))(_at_work(_typed))


def _usage(error: Any) -> BaseException:
    """Return the refusal of wrong usage; the page of help that `penode` alone shows is none."""
    message = error.format_message().strip()
    if "\n" in message or not message:
        if message:
            error.show()
        return SystemExit(error.exit_code)
    message = message.replace(". Did you mean", ", did you mean").rstrip(".?")
    page = error.ctx.command_path if error.ctx is not None else "penode"
    return InputError(f"{message[:1].lower()}{message[1:]}; see {page} --help.")


_NOTES = Notes()


def main() -> None:
    """Run the command line; bad input is refused in one sentence."""
    use_tolerant_streams()
    raise_lost_interrupts()
    LOG.addHandler(_NOTES)  # again is as once
    try:
        try:
            app(prog_name="penode")
        finally:
            flush_output()
    except Interrupted as stop:
        say(str(stop))
        sys.exit(130)
    except Exception as error:
        sentence, status = why_and_status(error)
        say(f"error: {sentence}")
        sys.exit(status)
