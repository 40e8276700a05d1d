"""Counts that a detector registered on the way: places, numbers, exposures, and the wind where it was measured."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from survey.core import DataObject, FloatArray, InputError, checked, existing_file, printable
from survey.io.tables import read_table, write_table
from survey.io.text_tables import read_text_table

_COUNT, _EXPOSURE = "counts", "exposure_s"
_PLACE, _WIND = ("easting_m", "northing_m"), ("wind_east_m_s", "wind_north_m_s")


@dataclass(frozen=True, eq=False, repr=False)
class Counts(DataObject):
    """Counts of a detector, in the order in which they were taken.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Easting and northing of the detector [m].
    n : (N,) ndarray
        Counts: whole numbers of 0 or more.
    exposure_s : (N,) ndarray
        Durations over which they were counted [s].
    wind_m_s : (N, 2) ndarray, optional
        Measured wind, to the east and to the north [m/s].

    Raises
    ------
    InputError
        Arrays of different lengths, counts that are negative or no whole numbers, exposures of 0 or less.

    Examples
    --------
    >>> len(Counts(np.zeros((12, 2)), np.arange(12.0), np.ones(12)))
    12
    """

    xy: FloatArray
    n: FloatArray
    exposure_s: FloatArray
    wind_m_s: FloatArray | None = None

    def __post_init__(self) -> None:
        n = checked(self.n, (None,), "the counts")
        wrong = np.flatnonzero((n < 0.0) | (n != np.round(n)))
        if len(wrong):
            raise InputError(
                f"count {wrong[0] + 1} of {len(n)} is {n[wrong[0]]:g}; counts are whole numbers of 0 or more: give the "
                "counts of the detector, not a rate, in the column counts."
            )
        exposure_s = checked(self.exposure_s, (len(n),), "the exposures")
        if (exposure_s <= 0.0).any():
            row = int(np.argmin(exposure_s))
            raise InputError(
                f"exposure {row + 1} of {len(n)} is {exposure_s[row]:g} s; an exposure is longer than 0 s."
            )
        object.__setattr__(self, "n", n)
        object.__setattr__(self, "exposure_s", exposure_s)
        object.__setattr__(self, "xy", checked(self.xy, (len(n), 2), "the places of the counts"))
        if self.wind_m_s is not None:
            object.__setattr__(self, "wind_m_s", checked(self.wind_m_s, (len(n), 2), "the wind"))

    def __len__(self) -> int:
        return len(self.n)

    def last(self, k: int) -> Self:
        """Return the last k counts."""
        wind = None if self.wind_m_s is None else self.wind_m_s[-k:]
        return type(self)(self.xy[-k:], self.n[-k:], self.exposure_s[-k:], wind)

    def __add__(self, other: "Counts") -> Self:
        return type(self)(
            np.vstack([self.xy, other.xy]),
            np.concatenate([self.n, other.n]),
            np.concatenate([self.exposure_s, other.exposure_s]),
            None
            if self.wind_m_s is None or other.wind_m_s is None
            else np.vstack([self.wind_m_s, other.wind_m_s]),
        )

    def in_blocks(self, most: int) -> Self:
        """Return sums over consecutive counts, at most `most` of them, at their mean places.

        The sum of Poisson counts is one of the summed intensity. A gap of the way that is ten times the median step ends a block.
        """
        size = int(np.ceil(len(self) / most))
        if size <= 1:
            return self
        step_m = np.hypot(*np.diff(self.xy, axis=0).T)
        run = np.r_[0, np.cumsum(step_m > 10.0 * max(float(np.median(step_m)), 1e-3))]
        _, begin, length = np.unique(run, return_index=True, return_counts=True)
        within = np.arange(len(self)) - np.repeat(begin, length)
        first = np.flatnonzero(within % size == 0)
        many = np.diff(np.r_[first, len(self)])[:, None]
        wind = None if self.wind_m_s is None else np.add.reduceat(self.wind_m_s, first, axis=0) / many
        xy = np.add.reduceat(self.xy, first, axis=0) / many
        return type(self)(xy, np.add.reduceat(self.n, first), np.add.reduceat(self.exposure_s, first), wind)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a CSV with the columns easting_m, northing_m, counts and exposure_s, and wind_east_m_s and wind_north_m_s if it has them."""
        columns = _columns(Path(path))
        for name, values in columns.items():
            unknown = np.flatnonzero(~np.isfinite(values))
            if len(unknown):
                raise InputError(
                    f"{path}: the column {name} has no number in row {unknown[0] + 1} of {len(values)}; remove the row or correct it."
                )
        winds = [columns.get(name) for name in _WIND]
        if (winds[0] is None) != (winds[1] is None):
            raise InputError(
                f"{path} has one of the columns {' and '.join(_WIND)}; wind needs both, or none."
            )
        wind: Any = None if winds[0] is None else np.column_stack(winds)  # type: ignore[arg-type]
        xy = np.column_stack([columns[name] for name in _PLACE])
        if np.all(np.abs(xy) <= (360.0, 90.0)) and np.all(np.ptp(xy, axis=0) < 1.0):
            raise InputError(
                f"{path}: the places lie about ({xy[0, 0]:g}, {xy[0, 1]:g}), which are degrees; give easting_m and northing_m in metres of "
                "a projected CRS."
            )
        try:
            return cls(xy, columns[_COUNT], columns[_EXPOSURE], wind)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    def write(self, path: str | Path) -> None:
        """Write a CSV that `read` reads."""
        columns = dict(zip(_PLACE, self.xy.T, strict=True)) | {_COUNT: self.n, _EXPOSURE: self.exposure_s}
        if self.wind_m_s is not None:
            columns |= dict(zip(_WIND, self.wind_m_s.T, strict=True))
        write_table(path, columns)


def _columns(path: Path) -> dict[str, FloatArray]:
    """Read the columns of a log: with commas, or with semicolons or tabs and decimal commas."""
    what, needed = "the counts", (*_PLACE, _COUNT, _EXPOSURE)
    file = existing_file(path, what)
    with file.open(encoding="utf-8-sig", errors="replace") as stream:
        header = stream.readline()
    if ";" not in header and "\t" not in header:
        return read_table(file, needed, what=what)
    table = read_text_table(file, what)
    missing = [name for name in needed if name not in table.header]
    if missing:
        raise InputError(
            f"{table.where} has no column {missing[0]} (found {printable(', '.join(table.header))[:200]}); the header must hold "
            f"{', '.join(needed)}."
        )
    return {name: table.numbers(name) for name in (*needed, *_WIND) if name in table.header}
