"""Loop closures found on the drive."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.sensors.records import SensorRecords
from survey.data.sensors.stakes import StakeSightings


@dataclass(frozen=True, eq=False, repr=False)
class LoopClosures(SensorRecords):
    """Loop closures: relative positions of two poses of the drive.

    Parameters
    ----------
    time_s, earlier_s : (N,) array_like
        Times of the later and of the earlier pose [s].
    offset : (N, 3) array_like
        Position of the body at `time_s` relative to that at `earlier_s` [m], in the body frame
        at `earlier_s`.
    covariance : (N, 3, 3) array_like
        Of `offset` [m²].
    """

    COLUMNS: ClassVar = StakeSightings.COLUMNS
    WHAT: ClassVar = "loop closures"

    earlier_s: FloatArray
    offset: FloatArray
    covariance: FloatArray

    def _check_order(self, times: FloatArray) -> None:
        """Check that times do not decrease; several places may be recognized at once."""
        if (np.diff(times) < 0).any():
            raise InputError(f"the times of the {self.WHAT} run backwards; sort them.")
