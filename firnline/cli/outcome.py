"""Exit codes of the commands, and the one sentence that each refusal ends with.

0 done · 1 internal fault · 2 usage · 3 bad input or output · 4 bad configuration · 5 done, but the
wanted class was not met · 130 interrupted · 141 the reader of the output closed it.
"""

import functools
import io
import logging
import os
import sys
import traceback
from collections.abc import Callable
from contextvars import Context
from typing import NoReturn, ParamSpec, TypeVar

import typer

P = ParamSpec("P")
R = TypeVar("R")

UNUSABLE = 3
NOT_MET = 5
INTERRUPTED = 130
OUTPUT_CLOSED = 141
_TRACEBACK = "FIRNLINE_TRACEBACK"
_INTERRUPTED_SENTENCE = (
    "interrupted; complete results stay as they were, and the same command can be run again."
)


def with_exit_codes(command: Callable[P, R]) -> Callable[P, R]:
    """Turn exceptions of a command into one sentence on stderr and an exit code.

    Returns: the same command; with ``-vv``, or with FIRNLINE_TRACEBACK=1 in the environment, an internal
    fault also prints its traceback.
    """

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            # A context of its own: whether feet were read is not handed on to the next command of the same process.
            result = Context().run(command, *args, **kwargs)
            sys.stdout.flush()
        except (typer.Exit, typer.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:
            _end(error, has_verbose="verbose" in kwargs)
        return result

    return guarded


def run_guarded(run: Callable[[], None]) -> None:
    """Run the command line with exit codes also for what happens outside a command: parsing, ``--help``."""
    for output in (sys.stdout, sys.stderr):
        # A name that is no UTF-8 is printed with escapes.
        if isinstance(output, io.TextIOWrapper):
            output.reconfigure(errors="backslashreplace")
    try:
        run()
        sys.stdout.flush()
    except SystemExit as ending:
        if isinstance(ending.__context__, BrokenPipeError):
            raise SystemExit(OUTPUT_CLOSED) from ending
        raise
    except (OSError, MemoryError, ImportError, KeyboardInterrupt) as error:
        try:
            _end(error)
        except typer.Exit as ending:
            raise SystemExit(ending.exit_code) from error


def _end(error: BaseException, *, has_verbose: bool = False) -> NoReturn:
    """Print what happened and leave with the exit code that belongs to it."""
    if isinstance(error, KeyboardInterrupt):  # first, as it may have interrupted the imports of what follows
        _leave(_INTERRUPTED_SENTENCE, INTERRUPTED, error)
    if isinstance(error, BrokenPipeError):
        _discard_output()
        raise typer.Exit(OUTPUT_CLOSED) from error
    from survey.core import FirnlineError, printable

    if isinstance(error, FirnlineError):
        _leave(printable(str(error)), error.exit_code, error)
    sentence = _sentence(error)
    if sentence is not None:
        _leave(printable(sentence), UNUSABLE, error)
    logging.getLogger("firnline").debug("%s", traceback.format_exc())
    if "-vv" in sys.argv or os.environ.get(_TRACEBACK):
        traceback.print_exception(error)
    way = "-vv" if has_verbose else f"{_TRACEBACK}=1 before the command"
    _leave(
        printable(
            f"internal fault, {type(error).__name__}: {error}; report it with the traceback that {way} prints."
        ),
        1,
        error,
    )


def _sentence(error: BaseException) -> str | None:
    """Return the sentence for what the system refuses; None for a fault of firnline."""
    from survey.core.files import NO_SPACE
    from survey.core.foreign import limit_reached

    limit = limit_reached(error)
    if limit is not None:
        return f"{limit}, or take a smaller area or a coarser step, or fewer workers."
    if isinstance(error, UnicodeEncodeError):
        return f"the name {error.object[:80]!r} is not valid UTF-8; rename the file or folder."
    if isinstance(error, OSError):
        if error.filename is None:
            _discard_output()
        what = "the output" if error.filename is None else os.fsdecode(error.filename)
        remedy = (
            "free space" if error.errno in NO_SPACE else "check that it exists and may be read and written"
        )
        return f"{what}: {error.strerror or error}; {remedy}."
    return None


def _leave(sentence: str, code: int, error: BaseException) -> NoReturn:
    """Print a sentence, and below it the notes of its exception."""
    typer.echo(f"firnline: {sentence}", err=True)
    for note in getattr(error, "__notes__", ()):
        typer.echo(note, err=True)
    raise typer.Exit(code) from error


def _discard_output() -> None:
    """Send what is left in the buffer of stdout nowhere, so that the interpreter does not fail on it at its end."""
    try:
        descriptor = sys.stdout.fileno()
    except (OSError, ValueError):  # not a file, as in tests
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)
