"""Options and imports that the commands of a live survey share."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

Url = Annotated[
    str,
    typer.Argument(
        metavar="URL",
        help="udp://HOST:PORT sends to a vehicle, udpin://HOST:PORT waits for one that sends there; also tcp://HOST:PORT, "
        "serial:///dev/DEVICE:BAUD.",
    ),
]
Patience = Annotated[
    float, typer.Option("--patience", min=0.5, help="Time after which a silent vehicle counts as lost [s].")
]
System = Annotated[
    int | None,
    typer.Option("--system", min=1, max=255, help="MAVLink system id; by default the first that is heard."),
]


@contextmanager
def needs_live_extra() -> Iterator[None]:
    """Turn a missing package into a sentence that names the extra."""
    from survey.core.errors import InputError

    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"this command needs {error.name}, which is not installed; install firnline[live]."
        ) from error
