"""Check the types of a function's arguments against its annotations.

Only arguments that are plainly of another class are refused, in one sentence; checkers such as beartype and typeguard
check containers and protocols too, take a NumPy number for no `float`, and raise with texts of their own.
"""

import types
from collections.abc import Callable
from functools import cache, wraps
from inspect import signature
from numbers import Integral, Real
from typing import Annotated, Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

_NUMBERS: dict[type, tuple[type, ...]] = {float: (Real,), int: (Integral,), bool: (bool, np.bool_)}


def check_types(function: Callable[P, R]) -> Callable[P, R]:
    """Raise `TypeError` when an argument is of another type than the function's annotations say.

    Parameters annotated by classes, and unions of them, are checked; callables, protocols,
    containers and arrays are left to the function.

    >>> @check_types
    ... def area_m2(side_m: float) -> float:
    ...     return side_m**2
    >>> area_m2("3")
    Traceback (most recent call last):
    TypeError: area_m2() was given a str for 'side_m'; a float was expected.
    """
    parameters = signature(function)

    @cache
    def accepted() -> dict[str, tuple[type, ...]]:
        hints = get_type_hints(function, include_extras=False)
        found = {name: _classes(hints.get(name, Any)) for name in parameters.parameters}
        return {name: kinds for name, kinds in found.items() if kinds}

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in parameters.bind(*args, **kwargs).arguments.items():
            kinds = accepted().get(name)
            if kinds and not isinstance(value, tuple(n for k in kinds for n in _NUMBERS.get(k, (k,)))):
                raise TypeError(
                    f"{function.__name__}() was given {_named(type(value))} for {name!r}; "
                    f"{_either(kinds)} was expected."
                )
        return function(*args, **kwargs)

    return checked


def _classes(annotation: Any) -> tuple[type, ...]:
    """Return the classes that an annotation allows; empty when it is more than a union of classes."""
    if get_origin(annotation) is Annotated:
        return _classes(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        parts = [_classes(part) for part in get_args(annotation)]
        return tuple(kind for part in parts for kind in part) if all(parts) else ()
    plain = isinstance(annotation, type) and get_origin(annotation) is None
    checkable = plain and annotation not in (object, Any) and not getattr(annotation, "_is_protocol", False)
    return (annotation,) if checkable else ()


def _either(kinds: tuple[type, ...]) -> str:
    names = [_named(kind) for kind in kinds]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def _named(kind: type) -> str:
    """Return the name of a class with its article."""
    if kind is type(None):
        return "None"
    return f"{'an' if kind.__name__[0] in 'AEIOaeio' else 'a'} {kind.__name__}"
