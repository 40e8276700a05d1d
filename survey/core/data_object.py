"""Base class of frozen dataclasses that hold arrays: equality, representation, pickling and copying."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


class DataObject:
    """Frozen dataclass that holds arrays.

    Two objects are equal when they are of one class and all their fields are equal; arrays are
    compared element by element, and NaN equals NaN. Copies and unpickled objects hold read-only
    arrays where the original does. Values that a property has cached are not copied. Use it with
    ``@dataclass(frozen=True, eq=False, repr=False)``.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False, repr=False)
    ... class Profile(DataObject):
    ...     height_m: npt.NDArray[np.float64]
    >>> Profile(np.array([1.0, np.nan])) == Profile(np.array([1.0, np.nan]))
    True
    >>> Profile(np.zeros(3))
    Profile(height_m: (3,) float64)
    """

    __hash__ = None  # type: ignore[assignment]  # arrays cannot be hashed

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return _equal(self._compared(), other._compared())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._summary()})"

    def _summary(self) -> str:
        """Return one line that describes the fields."""
        known = {name: value for name, value in self._values().items() if value is not None}
        return ", ".join(f"{name}: {summary(value)}" for name, value in known.items())

    def _compared(self) -> dict[str, Any]:
        """Return what must be equal in equal objects."""
        return self._values()

    def _values(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]

    def __getstate__(self) -> dict[str, Any]:
        values = self._values()
        read_only = [n for n, v in values.items() if isinstance(v, np.ndarray) and not v.flags.writeable]
        return {"values": values, "read_only": read_only}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for name, value in state["values"].items():
            object.__setattr__(self, name, value)
            if name in state["read_only"]:
                value.flags.writeable = False


def summary(value: Any) -> str:
    """Return a short description of a value: shape and type of an array, length of a container."""
    if isinstance(value, np.ndarray):
        return f"{value.shape} {value.dtype}"
    if is_dataclass(value) or not isinstance(value, Mapping | list | tuple):
        text = repr(value)
        return text if len(text) <= 60 and "\n" not in text else type(value).__name__
    return f"{len(value)} entries"


def _equal(a: Any, b: Any) -> bool:
    """Compare two values, arrays element by element."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return _equal_arrays(np.asarray(a), np.asarray(b))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_equal(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list) and type(a) is type(b):
        return len(a) == len(b) and all(_equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (a != a and b != b)  # noqa: PLR0124  # NaN alone differs from itself
    return bool(a == b)


def _equal_arrays(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> bool:
    return np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f")
