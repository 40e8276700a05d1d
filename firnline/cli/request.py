"""Options of the command line from the fields of a request, their help, and the output of results.

A request declares its parameters once (`firnline.actions.interface`); `with_options_of` gives a command the options that
they state, and `print_result` prints a result as lines or as JSON.
"""

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import IntEnum
from functools import wraps
from inspect import Parameter, Signature, get_annotations, signature
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import typer

from firnline.actions.interface import Argument, Option, Result, preview_of, require_inputs
from firnline.cli.outcome import NOT_MET

Request = TypeVar("Request")

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Check all input and print what would be done; write nothing.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]
Verbose = Annotated[
    int, typer.Option("--verbose", "-v", count=True, help="More detail in the log; -vv shows tracebacks.")
]


class SurveyStep(IntEnum):
    """Steps of a survey, in the order in which ``firnline --help`` lists their commands."""

    BEGIN = 1
    PLAN = 2
    VEHICLE = 3
    DRIVE = 4
    MAP = 5
    JUDGE = 6
    RUN = 7
    READ = 8
    EXPLAIN = 9


@dataclass(frozen=True, kw_only=True)
class Printing:
    """Options of how a command reports its work."""

    dry_run: DryRun = False
    as_json: Json = False
    quiet: Quiet = False
    verbose: Verbose = 0


def with_options_of(request: type[Request]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options that a dataclass declares, and call it with one instance.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Greeting:
    ...     name: str
    ...     times: int = 1
    >>> @with_options_of(Greeting)
    ... def greet(request, loud: bool = False):
    ...     print(" ".join(["HELLO" if loud else "hello", request.name] * request.times))
    >>> greet(name="ice", times=2)
    hello ice hello ice
    """

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        further = list(signature(command).parameters.values())[1:]
        groups = [one for one in further if is_dataclass(one.annotation)]
        single = [one for one in further if one not in groups]
        parameters = [
            *_parameters(request),
            *(one.replace(kind=Parameter.KEYWORD_ONLY) for one in single),
            *(part for group in groups for part in _parameters(group.annotation)),
        ]

        @wraps(command)
        def called(**options: Any) -> None:
            own = {one.name: options.pop(one.name, one.default) for one in single}
            own |= {one.name: _taken(one.annotation, options) for one in groups}
            made = request(**options)
            units = getattr(made, "units", None)
            if units is not None:
                from survey.core.lengths import named_units, show_feet

                show_feet(named_units(units))
            require_inputs(made)
            command(made, **own)

        vars(called)["__signature__"] = Signature(parameters)
        called.__annotations__ = {one.name: one.annotation for one in parameters}
        return called

    return decorated


def _parameters(kind: type) -> list[Parameter]:
    """Return the fields of a dataclass as parameters of a command, its own before those of its bases."""
    hints = get_type_hints(kind, include_extras=True)
    by_name: dict[str, Field[Any]] = {field.name: field for field in fields(kind)}
    names = [name for base in kind.__mro__ for name in get_annotations(base) if name in by_name]
    return [
        Parameter(
            name, Parameter.KEYWORD_ONLY, default=_default(by_name[name]), annotation=_for_typer(hints[name])
        )
        for name in names
    ]


def _taken(kind: type, options: dict[str, Any]) -> Any:
    """Take the fields of a dataclass out of the options of a command."""
    names = [field.name for field in fields(kind)]
    return kind(**{name: options.pop(name) for name in names if name in options})


def perform(
    action: Callable[..., Result],
    request: Any,
    *,
    dry_run: bool = False,
    as_json: bool = False,
    quiet: bool = False,
) -> None:
    """Carry out an action, write its files and print its result, or print what it would do.

    ``quiet`` leaves out the progress of an action that reports it, and the result of one that does not.
    """
    if dry_run:
        print_result(preview_of(action, request))
    elif "progress" not in signature(action).parameters:
        print_result(action(request).write(), as_json=as_json, quiet=quiet)
    else:
        from firnline.cli.progress import counted

        with counted(quiet=quiet) as progress:
            made = action(request, progress)
        print_result(made.write(), as_json=as_json)


def print_result(result: Result, *, as_json: bool = False, quiet: bool = False) -> None:
    """Print the lines of a result or its JSON, and its notes on stderr; end with exit code 5 where a class is not met."""
    for note in result.notes:
        typer.echo(f"firnline: {note}", err=True)
    if as_json:
        typer.echo(result.as_json())
    elif not quiet:
        from survey.core.lengths import in_both

        for line in result.lines():
            typer.echo(in_both(line))
    if not result.is_met:
        raise typer.Exit(NOT_MET)


def _default(field: Field[Any]) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return Parameter.empty if field.default is MISSING else field.default


def _for_typer(hint: Any) -> Any:
    """Return an annotation with typer's options and arguments in place of those of a request."""
    if get_origin(hint) is not Annotated:
        return hint
    kind, *marks = get_args(hint)
    return Annotated[(kind, *map(_mark_for_typer, marks))]


def _mark_for_typer(mark: Any) -> Any:
    if isinstance(mark, Option):
        return typer.Option(*mark.names, **mark.settings)
    return typer.Argument(*mark.names, **mark.settings) if isinstance(mark, Argument) else mark


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
