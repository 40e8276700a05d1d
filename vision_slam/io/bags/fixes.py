"""Log of the fixes of a bag, with the standard deviations that they state."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.crs.vertical_datum import ELLIPSOIDAL
from survey.core.errors import InputError
from vision_slam.io.gps_log import GpsLog

_LEAST_STATED = 0.5


def bag_fixes(rows: Sequence[tuple[float, ...]], n_without_fix: int, place: Path) -> GpsLog:
    """Return the fixes of a bag.

    Parameters
    ----------
    rows : sequence of tuple
        Time [s], longitude, latitude [deg], height [m] and standard deviation [m] of each fix, 0 where it states none.
    n_without_fix : int
        Messages without a fix, which are left out.
    place : Path
        The bag.

    Raises
    ------
    InputError
        No fix.
    """
    if not rows:
        raise InputError(
            f"{place} holds {n_without_fix} NavSatFix messages and no fix among them; record again once there is one."
        )
    table = np.array(rows)
    sigma_m, notes = _stated_sigma_m(table[:, 4])
    log = GpsLog(table[:, 0], table[:, 1:4], True, True, n_without_fix, ELLIPSOIDAL, sigma_m, notes)
    return log.without_zero_places(str(place))


def _stated_sigma_m(sigma_m: FloatArray) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return standard deviations (N,) [m], the largest for fixes that state none, or None where most state none; and a note."""
    is_stated = sigma_m > 0.0
    n_stated, n = int(is_stated.sum()), len(sigma_m)
    if n_stated == n:
        return sigma_m, ()
    if n_stated <= _LEAST_STATED * n:
        note = f"{n_stated} of {n} fixes state a covariance, which is not used"
        return None, ((note,) if n_stated else ())
    largest_m = float(sigma_m[is_stated].max())
    return np.where(is_stated, sigma_m, largest_m), (
        f"{n - n_stated} of {n} fixes state no covariance and take the largest standard deviation of the others, {largest_m:.3g} m",
    )
