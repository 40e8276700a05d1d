"""What localization leaves on the disk: path, landmarks, health of the frames, and pictures of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.core.files import replacing
from survey.core.geodesy import same_crs
from survey.data.sensors import GpsFixes
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.figures import error_over_distance, path_map, png_bytes
from survey.io.tables import write_table
from survey.io.tracks import write_track, write_tum
from vision_slam.evaluation import absolute_errors_m, matched_times
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.io.sequence import Sensed
from vision_slam.localization import Localization
from vision_slam.odometry.visual_slam import VisualOdometry
from vision_slam.plotting import tracks_on_frames
from vision_slam.rotation import quaternions, rotations

_WHOLE = "trajectory.tum"
_OTHERS = (
    *("trajectory.csv", "trajectory.error.npz", "online_trajectory.csv", "track.gpkg", "health.csv"),
    *("landmarks.csv", "landmarks.gpkg", "map.png", "tracks.png", "errors.png"),
)


@dataclass(frozen=True)
class Localized:
    """Path and landmarks of one recording, in the world or, without fixes, counted from its own start.

    Parameters
    ----------
    time_s : (N,) ndarray
        Times of the poses [s].
    position, quaternion : (N, 3) and (N, 4) ndarray
        Poses of the body; the quaternion as x, y, z, w.
    landmarks : (M, 3) ndarray
        Points of the surface.
    sigma_z_m : (M,) ndarray
        Standard deviation of their elevation [m].
    found : VisualOdometry, optional
        What the images gave, where there were any.
    trajectory, points : optional
        The same in the world, with covariances.
    online : Trajectory, optional
        The causal path: each pose uses only records up to its own time.
    notes : tuple of str
        Corrections of the input and assumptions about it, one sentence each.
    n_fixes, n_fixes_refused : int
        Fixes within the time of the path, and those of them that failed the innovation gate.
    """

    time_s: FloatArray
    position: FloatArray
    quaternion: FloatArray
    landmarks: FloatArray
    sigma_z_m: FloatArray
    found: VisualOdometry | None = None
    trajectory: Trajectory | None = None
    points: SurfacePoints | None = None
    online: Trajectory | None = None
    notes: tuple[str, ...] = ()
    n_fixes: int = 0
    n_fixes_refused: int = 0

    @classmethod
    def in_the_world(cls, result: Localization) -> "Localized":
        """Return what was localized with fixes."""
        t, points = result.trajectory, result.points
        return cls(
            t.time_s,
            t.position,
            t.quaternion,
            points.xyz,
            points.sigma_z,
            result.visual_odometry,
            t,
            points,
            result.online_trajectory,
            result.notes,
            result.n_fixes,
            result.n_fixes_refused,
        )

    @classmethod
    def from_its_start(cls, found: VisualOdometry) -> "Localized":
        """Return what was localized by images alone: x forward, y left, z up at the first image."""
        odometry, sightings = found.odometry, found.sightings
        path = dead_reckoning(odometry, np.zeros(3))
        turn = rotations(odometry.attitude_rad[sightings.pose])
        landmarks = path[sightings.pose] + np.einsum("nij,nj->ni", turn, sightings.offset)
        covariance = turn @ sightings.covariance @ turn.transpose(0, 2, 1)
        sigma_z_m = np.sqrt(covariance[:, 2, 2])
        return cls(odometry.time_s, path, quaternions(odometry.attitude_rad), landmarks, sigma_z_m, found)

    @property
    def length_m(self) -> float:
        """Distance travelled [m]."""
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())

    @property
    def covariance(self) -> FloatArray | None:
        """Of the positions (N, 3, 3) [m²]; None where they count from their own start."""
        return None if self.trajectory is None else self.trajectory.covariance

    @property
    def is_lost(self) -> BoolArray | None:
        """Where the path is not to be accepted."""
        if self.trajectory is not None:
            return np.asarray(self.trajectory.health) < 0.5
        return None if self.found is None else self.found.is_lost


@dataclass(frozen=True)
class Compared:
    """Positions (K, 3) of an estimate and of its reference at the same times, and which poses those are."""

    position: FloatArray
    reference: FloatArray
    covariance: FloatArray | None
    is_lost: BoolArray | None

    @property
    def figures(self) -> dict[str, float]:
        """Errors without any alignment [m]."""
        error = self.position - self.reference
        distance = absolute_errors_m(self.position, self.reference)
        driven = float(np.linalg.norm(np.diff(self.reference, axis=0), axis=1).sum())
        return {
            "horizontal_rms_m": float(np.sqrt(np.mean(error[:, :2] ** 2) * 2.0)),
            "vertical_rms_m": float(np.sqrt(np.mean(error[:, 2] ** 2))),
            "end_error_m": float(distance[-1]),
            "worst_error_m": float(distance.max()),
            "end_error_per_cent": 100.0 * float(distance[-1]) / max(driven, 1e-9),
        }


def compared_in_the_world(localized: Localized, reference: Trajectory) -> Compared:
    """Hold an estimate against a reference in the same CRS, interpolated to its times.

    Raises
    ------
    InputError
        Another CRS, or no common time.
    """
    assert localized.trajectory is not None
    same_crs(localized.trajectory.crs, reference.crs, "the estimate and its reference")
    common = (localized.time_s >= reference.time_s[0]) & (localized.time_s <= reference.time_s[-1])
    if common.sum() < 2:
        raise InputError(
            f"the reference covers {reference.time_s[0]:.1f} to {reference.time_s[-1]:.1f} s and none of the path; "
            "name one of the same drive."
        )
    time_s = localized.time_s[common]
    real = np.column_stack([np.interp(time_s, reference.time_s, axis) for axis in reference.position.T])
    return _compared(localized, common, real)


def compared_from_its_start(localized: Localized, time_s: FloatArray, reference: FloatArray) -> Compared:
    """Hold an estimate against reference poses (R, 4, 4), both counted from the first pose that they share."""
    estimated, real = matched_times(localized.time_s, time_s)
    if len(estimated) < 2:
        raise InputError(
            "fewer than two poses have a reference within 0.01 s; give reference poses at the images' times."
        )
    first = reference[real[0]]
    in_first = (reference[real, :3, 3] - first[:3, 3]) @ first[:3, :3]
    return _compared(localized, estimated, in_first + localized.position[estimated[0]])


def _compared(localized: Localized, chosen: Any, reference: FloatArray) -> Compared:
    covariance, is_lost = localized.covariance, localized.is_lost
    return Compared(
        localized.position[chosen],
        reference,
        None if covariance is None else covariance[chosen],
        None if is_lost is None else is_lost[chosen],
    )


def refuse_existing(folder: Path, *, force: bool) -> None:
    """Refuse a folder that holds a localization already, unless it may be replaced."""
    if (folder / _WHOLE).exists() and not force:
        raise InputError(f"{folder} holds a localization; choose another folder with --out or add --force.")


def write_localization(folder: Path, localized: Localized) -> None:
    """Write path, landmarks and health; ``trajectory.tum`` comes last and stands for the whole.

    Each file is whole or not there. In the world there are also ``trajectory.csv`` with
    covariances, ``online_trajectory.csv`` with what was known at every moment, ``track.gpkg``
    and ``landmarks.gpkg``.

    Raises
    ------
    InputError
        The folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (_WHOLE, *_OTHERS):  # nothing of an older drive stays beside this one
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be written to ({error.strerror}); choose another with --out."
        ) from error
    if localized.trajectory is not None and localized.points is not None:
        trajectory = localized.trajectory
        trajectory.write(folder / "trajectory.csv")
        if localized.online is not None:
            localized.online.write(folder / "online_trajectory.csv")
        write_track(folder / "track.gpkg", trajectory.time_s, trajectory.position, trajectory.crs)
        localized.points.write(folder / "landmarks.csv")
        localized.points.write(folder / "landmarks.gpkg")
    else:
        x, y, z = localized.landmarks.T
        columns = {"x_m": x, "y_m": y, "z_m": z, "sigma_z_m": localized.sigma_z_m}
        write_table(folder / "landmarks.csv", columns)
    if localized.found is not None:
        write_table(folder / "health.csv", health_columns(localized.found))
    write_tum(folder / _WHOLE, np.column_stack([localized.time_s, localized.position, localized.quaternion]))


_HEALTH = ("entropy_bits", "saturated", "sharpness", "n_followed", "n_inliers", "is_visual")


def health_columns(found: VisualOdometry) -> dict[str, FloatArray]:
    """Return one row a frame: what was known of its image, and whether its pose is to be accepted."""
    columns = {name: np.array([getattr(frame, name) for frame in found.health], float) for name in _HEALTH}
    return {"time_s": found.odometry.time_s} | columns | {"is_lost": found.is_lost.astype(float)}


def write_pictures(folder: Path, pictures: Mapping[str, Figure]) -> None:
    """Write figures as PNG."""
    for name, figure in pictures.items():
        with replacing(folder / f"{name}.png") as draft:
            draft.write_bytes(png_bytes(figure))


def pictures_of(
    localized: Localized,
    drive: Sensed,
    gps: GpsFixes | None = None,
    compared: Compared | None = None,
) -> dict[str, Figure]:
    """Draw tracks on frames, the map with its ellipses and, where there is a reference, errors over distance."""
    pictures = {
        "map": path_map(
            localized.position,
            localized.covariance,
            landmarks=localized.landmarks,
            landmark_sigma_m=localized.sigma_z_m,
            fixes=None if gps is None else gps.position,
            reference=None if compared is None else compared.reference,
            is_lost=localized.is_lost,
            in_the_world=localized.trajectory is not None,
        )
    }
    if drive.frames is not None and len(drive.frames) > 1:
        pictures["tracks"] = tracks_on_frames(drive)
    if compared is not None:
        pictures["errors"] = error_over_distance(
            compared.position, compared.reference, compared.covariance, compared.is_lost
        )
    return pictures
