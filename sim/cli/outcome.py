"""How a command ends.

0 done · 1 internal fault · 2 usage · 3 bad input · 4 bad configuration · 5 done, but the
wanted class was not met · 130 interrupted, resumable.
"""

import functools
import logging
import sys
import traceback
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

P = ParamSpec("P")
R = TypeVar("R")

NOT_MET = 5
INTERRUPTED = 130


def with_exit_codes(command: Callable[P, R]) -> Callable[P, R]:
    """Turn firnline's refusals into one sentence on stderr and an exit code."""

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        from survey.core.errors import FirnlineError

        try:
            return command(*args, **kwargs)
        except FirnlineError as error:
            typer.echo(f"firnline: {error}", err=True)
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt as interruption:
            typer.echo("firnline: interrupted; the same command goes on where it was.", err=True)
            raise typer.Exit(INTERRUPTED) from interruption
        except (typer.Exit, typer.Abort):
            raise
        except Exception as fault:
            logging.getLogger("firnline").debug("%s", traceback.format_exc())
            if "-vv" in sys.argv:
                traceback.print_exc()
            typer.echo(
                f"firnline: internal fault, {type(fault).__name__}: {fault}; add -vv for the traceback and tell us.",
                err=True,
            )
            raise typer.Exit(1) from fault

    return guarded


refusals_told = with_exit_codes
