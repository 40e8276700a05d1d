"""Stakes in the ice: their places and sightings of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from survey.core.arrays import FloatArray, IntArray, checked
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.data.sensors.records import SensorRecords
from survey.io.tables import read_table, write_table


@dataclass(frozen=True, eq=False, repr=False)
class StakeSightings(SensorRecords):
    """Sightings of surveyed stakes.

    ``stake`` (N,) is the index into the recording's stakes, ``offset`` (N, 3) the stake's
    foot relative to the body [m] in the body frame, ``covariance`` (N, 3, 3) its error [m²].

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    stake : (N,) array_like
        Index into the stakes of the recording.
    offset : (N, 3) array_like
        Foot of the stake in the body frame [m].
    covariance : (N, 3, 3) array_like
        Of `offset` [m²].
    """

    COLUMNS: ClassVar = {
        "offset": ("forward_m", "left_m", "up_m"),
        "covariance": ("var_ff_m2", "cov_fl_m2", "cov_fu_m2", "var_ll_m2", "cov_lu_m2", "var_uu_m2"),
    }
    WHAT: ClassVar = "sightings of stakes"

    stake: FloatArray
    offset: FloatArray
    covariance: FloatArray

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several stakes may be seen at once."""
        refuse_backward_times(times, self.WHAT)

    @property
    def index(self) -> IntArray:
        """Index of the stake (N,), integer."""
        return self.stake.astype(np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class StakeSurveys(SensorRecords):
    """Repeated surveys of stakes that move with the ice.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, not decreasing [s], on the clock of the recording.
    stake : (N,) array_like
        Index of the stake.
    position : (N, 3) array_like
        Easting, northing and elevation of its foot, where it meets the surface [m].
    sigma_m : (N,) array_like
        Standard deviation of each coordinate [m].
    """

    COLUMNS: ClassVar = {"position": ("easting_m", "northing_m", "elevation_m")}
    WHAT: ClassVar = "surveys of stakes"

    stake: FloatArray
    position: FloatArray
    sigma_m: FloatArray

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.sigma_m > 0.0).all():
            raise InputError(
                f"some {self.WHAT} have a standard deviation of 0 or less; state their standard deviations."
            )
        if (self.stake < 0).any() or (self.stake != np.floor(self.stake)).any():
            raise InputError(f"some {self.WHAT} name no stake; number the stakes 0, 1, 2 and so on.")

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several stakes may be surveyed at once."""
        refuse_backward_times(times, self.WHAT)

    @property
    def index(self) -> IntArray:
        """Index of the stake (N,), integer."""
        return self.stake.astype(np.int64)


def refuse_backward_times(times: FloatArray, what: str) -> None:
    """Refuse times (N,) that decrease."""
    if (np.diff(times) < 0).any():
        raise InputError(f"the times of the {what} run backwards; sort them.")


@dataclass(frozen=True, eq=False, repr=False)
class Stakes(DataObject):
    """Benchmarks of surveyed position: `position` (K, 3) world [m], `sigma_m` (K,) of each coordinate.

    Parameters
    ----------
    position : (K, 3) array_like
        Easting, northing and elevation [m].
    sigma_m : (K,) array_like
        Standard deviation of each coordinate [m].
    time_s : (K,) array_like, optional
        Times of the survey on the clock of the recording [s], for stakes that move with the ice.
    """

    position: FloatArray
    sigma_m: FloatArray
    time_s: Any = None

    def __post_init__(self) -> None:
        position = checked(self.position, (None, 3), "the positions of the stakes")
        object.__setattr__(self, "position", position)
        object.__setattr__(
            self, "sigma_m", checked(self.sigma_m, (len(position),), "the errors of the stakes")
        )
        if self.time_s is not None:
            times = checked(self.time_s, (len(position),), "the times of the stakes")
            object.__setattr__(self, "time_s", times)

    def __len__(self) -> int:
        return len(self.position)

    def write(self, path: str | Path) -> None:
        """Write a CSV table.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        east, north, up = self.position.T
        columns = {"easting_m": east, "northing_m": north, "elevation_m": up, "sigma_m": self.sigma_m}
        write_table(path, columns if self.time_s is None else columns | {"time_s": self.time_s})

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the CSV table of `write`.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        Stakes
            The records.

        Raises
        ------
        InputError
            Missing, cut off, a missing column, or a value that is no number.
        """
        names = ("easting_m", "northing_m", "elevation_m", "sigma_m")
        table = read_table(path, names, what="the table of stakes")
        place = np.column_stack([table[name] for name in names[:3]])
        return cls(place, table["sigma_m"], table.get("time_s"))
