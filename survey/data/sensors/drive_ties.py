"""Places that two drives have both seen from above."""

from dataclasses import dataclass
from typing import ClassVar

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.sensors.records import SensorRecords
from survey.data.sensors.stakes import refuse_backward_times


@dataclass(frozen=True, eq=False, repr=False)
class DriveTies(SensorRecords):
    """Relative positions of two poses of different drives.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of the poses of the first drive, on its clock [s].
    first, second : (N,) array_like
        Numbers of the drives, counted from 0; the second number is the larger one.
    second_s : (N,) array_like
        Times of the poses of the second drive, on its clock [s].
    offset : (N, 3) array_like
        Position of the second body relative to the first: east, north, up [m].
    covariance : (N, 3, 3) array_like
        Of `offset` [m²].

    Raises
    ------
    InputError
        Wrong shapes, NaN, times that run backwards, or a pose that is tied to its own drive.
    """

    COLUMNS: ClassVar = {
        "offset": ("east_m", "north_m", "up_m"),
        "covariance": ("var_ee_m2", "cov_en_m2", "cov_eu_m2", "var_nn_m2", "cov_nu_m2", "var_uu_m2"),
    }
    WHAT: ClassVar = "ties between drives"

    first: FloatArray
    second: FloatArray
    second_s: FloatArray
    offset: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        super().__post_init__()
        if not ((self.first >= 0) & (self.first < self.second)).all():
            raise InputError(
                f"some {self.WHAT} do not name two drives in their order; count drives from 0, the smaller number first."
            )

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several places may be shared at once."""
        refuse_backward_times(times, self.WHAT)
