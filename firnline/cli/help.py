"""Help of the commands, with examples on one line each, and the option ``--version``."""

import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

# click neither joins nor breaks the lines of a paragraph that begins with this mark.
_UNBROKEN = "\b"


def help_of(command: Callable[..., Any]) -> str:
    """Return the docstring of a command as its help, with examples that are not broken at the terminal's width."""
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    return "\n\n".join(_UNBROKEN + "\n" + one if _is_example(one) else one for one in paragraphs)


def _is_example(paragraph: str) -> bool:
    return paragraph.startswith("  firnline ") and "\n" not in paragraph


def print_version(wanted: bool) -> None:
    """Print the version and leave, where it is asked for."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"firnline {version('firnline')}")
        raise typer.Exit


def options(
    _: Annotated[
        bool,
        typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Plan, simulate and judge robotic surveys of glaciers and other terrain."""
