"""Commands whose options are the fields of a dataclass."""

from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from functools import wraps
from inspect import Parameter, Signature, get_annotations
from typing import Any, TypeVar, get_type_hints

Request = TypeVar("Request")


def with_options_of(request: type[Request]) -> Callable[[Callable[[Request], None]], Callable[..., None]]:
    """Give a command the options that a dataclass declares, and call it with one instance.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Greeting:
    ...     name: str
    ...     times: int = 1
    >>> @with_options_of(Greeting)
    ... def greet(request):
    ...     print(" ".join(["hello", request.name] * request.times))
    >>> greet(name="ice", times=2)
    hello ice hello ice
    """
    hints = get_type_hints(request, include_extras=True)
    by_name: dict[str, Field[Any]] = {field.name: field for field in fields(request)}  # type: ignore[arg-type]
    parameters = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=_default(by_name[name]), annotation=hints[name])
        for kind in request.__mro__
        for name in get_annotations(kind)
        if name in by_name
    ]

    def decorated(command: Callable[[Request], None]) -> Callable[..., None]:
        @wraps(command)
        def called(**options: Any) -> None:
            command(request(**options))

        vars(called)["__signature__"] = Signature(parameters)
        called.__annotations__ = {one.name: one.annotation for one in parameters}
        return called

    return decorated


def _default(field: Field[Any]) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return Parameter.empty if field.default is MISSING else field.default
