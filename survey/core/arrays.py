"""Read-only arrays of a stated shape, and base classes of the frozen data types that hold them.

`checked` converts an argument to a read-only float array and refuses another shape, NaN and infinity. `DataObject` is
the base class of frozen dataclasses with arrays: equality, representation, pickling and copying. `ReadOnlyMapping` can
be pickled and copied, which `types.MappingProxyType` cannot.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from survey.core.errors import InputError

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
Bounds = tuple[float, float, float, float]
"""West, south, east and north [m]."""
Progress = Callable[[str, int, int], None]
"""Progress callback: what is being done, how many of it are done, and how many there are."""


def frozen(values: Any, dtype: Any = np.float64) -> Any:
    """Return a read-only copy in C order."""
    array = np.array(values, dtype=dtype, order="C")
    array.flags.writeable = False
    return array


def lattice_places(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return every pair of an easting and a northing, row by row.

    `x` (W,): eastings of the columns. `y` (H,): northings of the rows. Returns (H * W, 2): easting and
    northing.

    >>> lattice_places(np.array([0.0, 1.0]), np.array([5.0])).tolist()
    [[0.0, 5.0], [1.0, 5.0]]
    """
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def checked(values: Any, shape: Sequence[int | None], what: str) -> FloatArray:
    """Return a read-only float array; refuse another shape, NaN and infinity.

    ``None`` in `shape` stands for any length.
    """
    try:
        array: FloatArray = frozen(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} are not numbers ({error}); give an array of floats.") from error
    wanted = "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        raise InputError(f"{what} have the shape {array.shape}; {wanted} was expected.")
    if not np.isfinite(array).all():
        n_bad = int((~np.isfinite(array)).sum())
        raise InputError(
            f"{what} hold {n_bad} values that are NaN or infinite; remove or correct them first."
        )
    return array


class DataObject:
    """Frozen dataclass that holds arrays.

    Two objects are equal when they are of one class and all their fields are equal; arrays are
    compared element by element, and NaN equals NaN. Copies and unpickled objects hold read-only
    arrays where the original does. Values that a property has cached are not copied. Use it with
    ``@dataclass(frozen=True, eq=False, repr=False)``.

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
        return ", ".join(f"{name}: {summarize(value)}" for name, value in known.items())

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


def summarize(value: Any) -> str:
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


K = TypeVar("K")
V = TypeVar("V")


class ReadOnlyMapping(Mapping[K, V]):
    """A mapping whose entries cannot be set or deleted.

    `values`: entries; a shallow copy is taken.

    >>> entries = ReadOnlyMapping({"length_m": 5.0})
    >>> entries["length_m"], entries == {"length_m": 5.0}, entries | {"n_turns": 2.0}
    (5.0, True, {'length_m': 5.0, 'n_turns': 2.0})
    """

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[K, V]) -> None:
        self._values = dict(values)

    def __getitem__(self, key: K) -> V:
        return self._values[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(self._values)

    def __or__(self, other: Mapping[K, V]) -> dict[K, V]:
        return {**self._values, **other}

    def __ror__(self, other: Mapping[K, V]) -> dict[K, V]:
        return {**other, **self._values}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._values,)


def root_mean_square(values: FloatArray) -> float:
    """Return the root mean square.

    >>> root_mean_square(np.array([1.0, -7.0]))
    5.0
    """
    return float(np.sqrt(np.mean(values**2)))
