"""Landmarks of several drives as the input of one joint map, and the corrections of their paths.

`PathCorrection` is the estimated error of a path with its covariance, and corrects a trajectory. `SeveralDrives` joins the
landmarks and the path errors of several drives, without correlation between the drives, and divides the correction of a
joint map among the paths.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from survey.core import DataObject, FloatArray, InputError, same_crs, same_vertical_datum
from survey.data import PathError, SurfacePoints, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class PathCorrection(DataObject):
    """Errors (K, 3) [m] of a path at times (K,) [s], and the covariance (K, 3, 3) [m²] of the estimate.

    `time_s` (K,): times of the keyframes [s]. `shift` (K, 3): estimated error of the position: east, north,
    up [m]. `covariance` (K, 3, 3): posterior covariance of that error [m²].

    >>> PathCorrection(np.array([0.0, 9.0]), np.zeros((2, 3)), np.zeros((2, 3, 3))).shift.shape
    (2, 3)
    """

    time_s: FloatArray
    shift: FloatArray
    covariance: FloatArray

    def mixed(self, other: "PathCorrection", share: float) -> "PathCorrection":
        """Return mean and covariance of the mixture with another correction."""
        apart = other.shift - self.shift
        spread = share * (1.0 - share) * apart[:, :, None] * apart[:, None, :]
        covariance = (1.0 - share) * self.covariance + share * other.covariance + spread
        return PathCorrection(self.time_s, self.shift + share * apart, covariance)

    def applied(self, trajectory: Trajectory) -> Trajectory:
        """Return the trajectory with corrected positions and without its shared error, which the map has used."""
        times = trajectory.time_s
        shift = np.column_stack([np.interp(times, self.time_s, column) for column in self.shift.T])
        entries = [np.interp(times, self.time_s, entry) for entry in self.covariance.reshape(-1, 9).T]
        covariance = np.column_stack(entries).reshape(-1, 3, 3)
        return replace(trajectory, position=trajectory.position - shift, covariance=covariance, error=None)


_COLUMNS = (
    "covariance", "sigma_m", "origins", "range_m", "own_covariance", "keyframe", "heading_rad", "body",
)  # fmt: skip


class SeveralDrives(NamedTuple):
    """Landmarks of all drives, and the error that they share through their paths.

    `points`: landmarks of all drives; their keyframes are counted through. `path`: errors of all paths,
    without correlation between drives; None where one is unknown. `time_s`: times of the keyframes of each
    drive [s]. `shift` (K, 3): errors of the keyframes of all drives [m] by which the landmarks were moved
    already.
    """

    points: SurfacePoints
    path: PathError | None
    time_s: list[FloatArray]
    shift: FloatArray | None = None

    @classmethod
    def of(cls, drives: Sequence[tuple[SurfacePoints, PathError | None]]) -> "SeveralDrives":
        """Join the landmarks and the path errors of drives over the same ground.

        Errors of different drives count as independent. Receivers under the same sky, or barometers in the same
        weather, share a part of theirs; where that part is large, give each drive the corrections of a base
        station.
        """
        errors = [error for _, error in drives if error is not None]
        is_known = len(errors) == len(drives)
        path = PathError.joined(errors) if is_known else None
        sizes = (
            [len(error) for error in errors] if is_known else [_n_keyframes(points) for points, _ in drives]
        )
        firsts = np.cumsum([0, *sizes[:-1]]).tolist()
        points = joined_points([points for points, _ in drives], firsts)
        return cls(points, path, [error.time_s for error in errors])

    def corrections(self, correction: PathCorrection) -> list[PathCorrection]:
        """Split the correction of all paths into that of each drive."""
        shift = correction.shift if self.shift is None else correction.shift + self.shift
        ends = np.cumsum([len(times) for times in self.time_s])
        parts = [slice(end - len(times), end) for end, times in zip(ends, self.time_s, strict=True)]
        return [
            PathCorrection(times, shift[part], correction.covariance[part])
            for times, part in zip(self.time_s, parts, strict=True)
        ]


def joined_points(parts: Sequence[SurfacePoints], first_keyframes: Sequence[int]) -> SurfacePoints:
    """Return the points of several drives as one set; the keyframes of a drive count from its first one."""
    if len(parts) == 1:
        return parts[0]
    for part in parts[1:]:
        same_crs(parts[0].crs, part.crs, "the landmarks of the first rover and those of another")
        same_vertical_datum(
            parts[0].vertical_datum,
            part.vertical_datum,
            "the landmarks of the first rover and those of another",
        )
    columns = {name: _column(parts, name) for name in _COLUMNS}
    if columns["keyframe"] is not None:
        first = np.repeat(first_keyframes, [len(part) for part in parts])
        columns["keyframe"] = columns["keyframe"] + first
    return SurfacePoints(
        np.vstack([part.xyz for part in parts]),
        values=_named([part.values for part in parts]),
        value_sigmas=_named([part.value_sigmas for part in parts]),
        crs=parts[0].crs,
        vertical_datum=parts[0].vertical_datum,
        **columns,
    )


def _column(parts: Sequence[SurfacePoints], name: str) -> FloatArray | None:
    """Return a column of all parts, or None where no part has it."""
    columns = [getattr(part, name) for part in parts]
    known = [column for column in columns if column is not None]
    if known and len(known) < len(parts):
        raise InputError(
            f"{len(known)} of {len(parts)} rovers have landmarks with {name}; localize all of them in the same way."
        )
    return np.concatenate(known) if known else None


def _named(columns: Sequence[Mapping[str, FloatArray]]) -> dict[str, FloatArray]:
    """Return the named columns that all parts have."""
    names = [name for name in columns[0] if all(name in others for others in columns)]
    return {name: np.concatenate([part[name] for part in columns]) for name in names}


def _n_keyframes(points: SurfacePoints) -> int:
    """Return a number of keyframes that holds those that the points name."""
    return 0 if points.keyframe is None else int(points.keyframe.max()) + 2
