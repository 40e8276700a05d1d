"""Cache of the latest results of a computation."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

_MOST = 24
Value = TypeVar("Value")


class ResultCache(Generic[Value]):
    """Results by key, the latest ones; each is computed once, also when several threads ask for it.

    >>> squares = ResultCache[int]()
    >>> squares.computed(3, lambda: 9), squares.get(3), squares.get(4)
    (9, 9, None)
    """

    def __init__(self) -> None:
        self._values: OrderedDict[Hashable, Value] = OrderedDict()
        self._busy: dict[Hashable, Lock] = {}
        self._lock = Lock()

    def get(self, key: Hashable) -> Value | None:
        """Return a result that is there; None for another key."""
        with self._lock:
            return self._values.get(key)

    def latest(self) -> Value | None:
        """Return the result that was asked for last."""
        with self._lock:
            return next(reversed(self._values.values()), None)

    def computed(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """Return a result, computed where it is not there yet."""
        with self._lock:
            busy = self._busy.setdefault(key, Lock())
        try:
            with busy:
                found = self.get(key)
                return self._store(key, compute() if found is None else found)
        finally:
            with self._lock:
                self._busy.pop(key, None)

    def _store(self, key: Hashable, value: Value) -> Value:
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > _MOST:
                self._values.popitem(last=False)
        return value
