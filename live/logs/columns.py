"""Columns of an autopilot's log, before they become a recording."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pyproj import CRS

from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs import projected_crs
from survey.core.errors import InputError
from survey.core.transformation import chosen_crs, transformed
from survey.data.recording import Recording
from survey.data.sensors.records import Compass, GpsFixes, Inertial, Wheels
from survey.io.vector import WGS84

LEAST_FIX = 3
# Horizontal errors of fixes by their type, where the receiver states none: 3-D, differential, RTK float, RTK fixed [m].
_SIGMA_M = {3: 1.1, 4: 0.6, 5: 0.3, 6: 0.02}
_BEST_TYPE = 6
_NORTHWARD_DEG = 1e-3
# Headings farther from the fixes than this were stamped by another clock.
_APART_S = 60.0


@dataclass
class LogColumns:
    """Rows of fixes, wheels and inertial readings.

    Parameters
    ----------
    fixes : list
        Time [s], longitude, latitude [deg], height [m], type of fix, stated horizontal error [m] or NaN.
    wheels : list
        Time [s], distance of the left and of the right side [m].
    inertial : list
        Time [s], rates [rad/s] and specific force [m/s²] forward, right, down.
    headings : list
        Time [s], yaw that the autopilot estimated, clockwise from true north [rad].
    """

    fixes: list[tuple[float, ...]] = field(default_factory=list)
    wheels: list[tuple[float, ...]] = field(default_factory=list)
    inertial: list[tuple[float, ...]] = field(default_factory=list)
    headings: list[tuple[float, ...]] = field(default_factory=list)

    def recording(self, path: Path, crs: CRS | str | None) -> tuple[Recording, tuple[str, ...]]:
        """Return the recording, and what was left out or assumed.

        Parameters
        ----------
        path : pathlib.Path
            The log, for messages.
        crs : str or pyproj.CRS, optional
            Projected CRS; the UTM zone of the first fix by default.

        Returns
        -------
        tuple of Recording and tuple of str
            The start is that of the first fix.

        Raises
        ------
        InputError
            Fewer than two fixes.
        """
        rows = np.array(self.fixes, dtype=np.float64).reshape(-1, 6)
        is_fix = (rows[:, 4] >= LEAST_FIX) & np.isfinite(rows[:, :4]).all(axis=1)
        rows = rows[is_fix]
        rows = rows[_increasing(rows[:, 0])]
        if len(rows) < 2:
            raise InputError(f"{path} holds {len(rows)} fixes of three dimensions; at least two are needed.")
        target = chosen_crs(rows[:1, 1], rows[:1, 2]) if crs is None else projected_crs(crs, "the log")
        xy = transformed(rows[:, 1:3], WGS84, target, "the fixes")
        gps = GpsFixes(rows[:, 0], np.column_stack([xy, rows[:, 3]]), _sigma_m(rows))
        notes = (
            f"works in {target.name}",
            f"{len(is_fix) - len(rows)} records of the receiver without a fix or out of order are left out",
        )
        wheels, inertial = _table(self.wheels, 3), _table(self.inertial, 7)
        recording = Recording(
            target,
            gps.position[0],
            gps,
            start_is_surveyed=False,
            wheels=None if len(wheels) == 0 else Wheels(*wheels.T),
            inertial=None if len(inertial) == 0 else _in_body_frame(inertial),
            compass=_compass(_table(self.headings, 2), rows, target),
        )
        return recording, notes


def _table(rows: list[tuple[float, ...]], n_columns: int) -> FloatArray:
    """Return finite rows with increasing times."""
    table = np.array(rows, dtype=np.float64).reshape(-1, n_columns)
    table = table[np.isfinite(table).all(axis=1)]
    found: FloatArray = table[_increasing(table[:, 0])]
    return found


def _increasing(time_s: FloatArray) -> BoolArray:
    """Return which times are later than all before them."""
    before = np.concatenate([[-np.inf], np.maximum.accumulate(time_s)[:-1]])
    later: BoolArray = time_s > before
    return later


def _sigma_m(rows: FloatArray) -> FloatArray:
    """Return the horizontal standard deviation of each fix: stated, or by the type of fix."""
    types = np.clip(rows[:, 4], LEAST_FIX, _BEST_TYPE).astype(int)
    by_type = np.array([_SIGMA_M[kind] for kind in types])
    stated = rows[:, 5]
    return np.where(np.isfinite(stated) & (stated > 0.0), stated, by_type)


def _in_body_frame(rows: FloatArray) -> Inertial:
    """Turn forward, right, down into forward, left, up."""
    turned = rows[:, 1:] * np.tile([1.0, -1.0, -1.0], 2)
    return Inertial(rows[:, 0], turned[:, :3], turned[:, 3:])


def _compass(headings: FloatArray, fixes: FloatArray, crs: CRS) -> Compass | None:
    """Turn headings clockwise from true north into those counter-clockwise from grid east, by the convergence at the start."""
    is_near = (headings[:, 0] >= fixes[0, 0] - _APART_S) & (headings[:, 0] <= fixes[-1, 0] + _APART_S)
    if not is_near.any():
        return None
    ends = fixes[0, 1:3] + np.array([[0.0, 0.0], [0.0, _NORTHWARD_DEG]])
    east, north = np.diff(transformed(ends, WGS84, crs, "the fixes"), axis=0)[0]
    heading = np.arctan2(north, east) - headings[is_near, 1]
    return Compass(headings[is_near, 0], (heading + np.pi) % (2.0 * np.pi) - np.pi)
