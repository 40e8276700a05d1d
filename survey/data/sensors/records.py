"""Common form of sensor records: tables of times and readings, checked, read and written."""

from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, checked
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.io.tables import read_table, write_table

UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False, repr=False)
class SensorRecords(DataObject):
    """Base class of sensor records: increasing times, one row per reading, a CSV table with units.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of the readings [s], increasing.

    Raises
    ------
    InputError
        Wrong shapes, NaN, too few readings, or times that do not increase.
    """

    COLUMNS: ClassVar[dict[str, tuple[str, ...]]] = {}
    """Columns of the fields that take several: 3 for a vector, 6 for a symmetric matrix."""
    WHAT: ClassVar[str] = "readings"
    LEAST: ClassVar[int] = 1

    time_s: FloatArray

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), f"the times of the {self.WHAT}")
        if len(times) < self.LEAST:
            raise InputError(f"there are {len(times)} {self.WHAT}; at least {self.LEAST} are needed.")
        self._check_order(times)
        object.__setattr__(self, "time_s", times)
        for field in fields(self)[1:]:
            if getattr(self, field.name) is None:
                continue
            shape = (len(times), *self._shape(field.name))
            values = checked(getattr(self, field.name), shape, f"the {field.name} of the {self.WHAT}")
            object.__setattr__(self, field.name, values)

    def _check_order(self, times: FloatArray) -> None:
        if (np.diff(times) <= 0).any():
            raise InputError(f"the times of the {self.WHAT} do not increase; sort them or remove repeats.")

    @classmethod
    def _shape(cls, name: str) -> tuple[int, ...]:
        return {0: (), 3: (3,), 6: (3, 3)}[len(cls.COLUMNS.get(name, ()))]

    def __len__(self) -> int:
        return len(self.time_s)

    def select(self, which: BoolArray) -> Self:
        """Return some of the readings.

        Parameters
        ----------
        which : (N,) ndarray of bool
            Whether each reading is selected.

        Returns
        -------
        SensorRecords
            The selected readings, of the same class.
        """
        values: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            values[field.name] = None if value is None else value[which]
        return type(self)(**values)

    def write(self, path: str | Path) -> None:
        """Write a CSV table whose header names the units.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        columns: dict[str, FloatArray] = {}
        for field in fields(self):
            if getattr(self, field.name) is None:
                continue
            values = np.asarray(getattr(self, field.name), dtype=np.float64)
            names = self.COLUMNS.get(field.name, (field.name,))
            flat = values[:, UPPER[0], UPPER[1]] if values.ndim == 3 else values.reshape(len(values), -1)
            columns |= dict(zip(names, flat.T, strict=True))
        write_table(path, columns)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        SensorRecords
            The records, of the class of the call.

        Raises
        ------
        InputError
            Missing, cut off, a column lacks, or something is no number.
        """
        needed = [field.name for field in fields(cls) if field.default is MISSING]
        names = {name: cls.COLUMNS.get(name, (name,)) for name in needed}
        table = read_table(path, [column for group in names.values() for column in group], what="the table")
        names |= {field.name: (field.name,) for field in fields(cls) if field.name in table}
        return cls(
            **{field: joined_columns([table[column] for column in group]) for field, group in names.items()}
        )


def joined_columns(columns: list[FloatArray]) -> FloatArray:
    """Put the columns of one field back together: a scalar, a vector or a symmetric matrix a row."""
    if len(columns) == 1:
        return columns[0]
    rows = np.column_stack(columns)
    if len(columns) == 3:
        return rows
    matrices = np.empty((len(rows), 3, 3))
    matrices[:, UPPER[0], UPPER[1]] = matrices[:, UPPER[1], UPPER[0]] = rows
    return matrices
