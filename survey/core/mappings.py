"""Read-only mapping that can be pickled and copied, which `types.MappingProxyType` cannot."""

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class ReadOnlyMapping(Mapping[K, V]):
    """A mapping whose entries cannot be set or deleted.

    Parameters
    ----------
    values : mapping
        Entries; a shallow copy is taken.

    Examples
    --------
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
