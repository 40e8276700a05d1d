"""Trajectory of a rover: times, poses and their covariances."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import shapely
from pyproj import CRS

from survey.core import DataObject, FloatArray, InputError, checked, projected_crs
from survey.core.time_units import LONGEST_STEP_S, refuse_other_unit
from survey.data.conversions import draw_lines, drawing, html_table, to_geodataframe
from survey.data.path_error import PathError
from survey.io.tables import read_table, write_table
from survey.io.trajectory_files import TUM_COLUMNS, read_tum, write_tum

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(DataObject):
    """Poses of a rover in the survey's CRS.

    Parameters
    ----------
    time_s : (N,) array_like
        Seconds since the start, strictly increasing.
    position : (N, 3) array_like
        Easting, northing, elevation [m] of the body's origin.
    quaternion : (N, 4) array_like
        Rotation from the body (x forward, y left, z up) to the world (east, north, up),
        as x, y, z, w.
    covariance : (N, 3, 3) array_like
        Of the position [m²].
    crs : str or pyproj.CRS
        Projected, in metres.
    health : (N,) array_like, optional
        1 where the pose can be trusted, 0 where it is lost; 1 by default.
    error : PathError, optional
        How the poses share their error: what a map must know to use the path twice.

    Raises
    ------
    InputError
        Wrong shapes, NaN, times that do not increase, quaternions that are not of unit length.
    """

    time_s: FloatArray
    position: FloatArray
    quaternion: FloatArray
    covariance: FloatArray
    crs: CRS
    health: Any = None
    error: PathError | None = None

    def __post_init__(self) -> None:
        time_s = checked(self.time_s, (None,), "the times of the trajectory")
        n = len(time_s)
        if n == 0:
            raise InputError("the trajectory has no poses.")
        if (np.diff(time_s) <= 0).any():
            first = int(np.flatnonzero(np.diff(time_s) <= 0)[0])
            raise InputError(
                f"the times of the trajectory do not increase after pose {first} ({time_s[first]:.3f} s); sort them or remove repeats."
            )
        refuse_other_unit(time_s, "the times of the trajectory", LONGEST_STEP_S)
        quaternion = checked(self.quaternion, (n, 4), "the orientations of the trajectory")
        if (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > 1e-3).any():
            raise InputError(
                "some orientations of the trajectory are no unit quaternions (x, y, z, w); check the columns."
            )
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(
            self, "position", checked(self.position, (n, 3), "the positions of the trajectory")
        )
        object.__setattr__(self, "quaternion", quaternion)
        object.__setattr__(
            self, "covariance", checked(self.covariance, (n, 3, 3), "the covariances of the trajectory")
        )
        object.__setattr__(self, "crs", projected_crs(self.crs, "the trajectory"))
        health = np.ones(n) if self.health is None else self.health
        object.__setattr__(self, "health", checked(health, (n,), "the health of the trajectory"))

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def length_m(self) -> float:
        """Distance travelled [m]."""
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())

    @drawing
    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the path from above.

        $axes
        """
        return draw_lines(ax, [(self.position[:, :2], {})])

    def to_geodataframe(self) -> "GeoDataFrame":
        """Return the poses as a table of points with time, standard deviations and health.

        Returns
        -------
        geopandas.GeoDataFrame
            One row for each pose; its point has easting, northing and elevation [m].

        Raises
        ------
        InputError
            When GeoPandas is not installed.
        """
        sigma = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        names = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
        columns = {"time_s": self.time_s, **dict(zip(names, sigma.T, strict=True)), "health": self.health}
        return to_geodataframe(shapely.points(self.position), columns, self.crs)

    def _summary(self) -> str:
        duration_s = self.time_s[-1] - self.time_s[0]
        return f"{len(self)} poses, {self.length_m:.1f} m in {duration_s:.1f} s, {self.crs.name}"

    def _repr_html_(self) -> str:
        sigma_m = np.sqrt(np.linalg.eigvalsh(self.covariance[-1, :2, :2])[-1])
        facts = {
            "poses": str(len(self)),
            "length": f"{self.length_m:.1f} m",
            "duration": f"{self.time_s[-1] - self.time_s[0]:.1f} s",
            "standard deviation at the end": f"{sigma_m:.2f} m",
            "CRS": self.crs.name,
        }
        return html_table("Trajectory", facts, self.plot)

    def write(self, path: str | Path) -> None:
        """Write ``.tum`` text (poses alone) or a ``.csv`` table (with covariance and health).

        Beside the table stands ``.error.npz``, where the poses' shared error is known.

        Parameters
        ----------
        path : str or pathlib.Path
            Ends in ``.tum`` or ``.csv``.
        """
        poses = np.column_stack([self.time_s, self.position, self.quaternion])
        if Path(path).suffix == ".tum":
            write_tum(path, poses)
        else:
            upper = self.covariance[:, _UPPER[0], _UPPER[1]]
            write_table(
                path, dict(zip(_COLUMNS, np.column_stack([poses, upper, self.health]).T, strict=True))
            )
            if self.error is not None:
                self.error.write(_beside(path))

    @classmethod
    def read(cls, path: str | Path, crs: CRS | str) -> Self:
        """Read what `write` wrote; TUM text (``.tum``, ``.txt``) has no covariance, it becomes zero.

        Parameters
        ----------
        path : str or pathlib.Path
            Ends in ``.tum``, ``.txt`` or ``.csv``.
        crs : str or pyproj.CRS
            Projected CRS of the positions, which the file does not name.

        Returns
        -------
        Trajectory
            With the shared error where its file stands beside the table.

        Raises
        ------
        InputError
            Missing, cut off, or not of that form.
        """
        if Path(path).suffix.lower() in (".tum", ".txt"):
            rows = read_tum(path)
            return cls(
                rows[:, 0], rows[:, 1:4], rows[:, 4:8], np.zeros((len(rows), 3, 3)), projected_crs(crs, "it")
            )
        table = read_table(path, _COLUMNS, what="the trajectory")
        rows = np.column_stack([table[name] for name in _COLUMNS])
        covariance = np.empty((len(rows), 3, 3))
        covariance[:, _UPPER[0], _UPPER[1]] = covariance[:, _UPPER[1], _UPPER[0]] = rows[:, 8:14]
        place, turn = rows[:, 1:4], rows[:, 4:8]
        error = PathError.read(_beside(path)) if _beside(path).exists() else None
        return cls(
            rows[:, 0], place, turn, covariance, projected_crs(crs, "the trajectory"), rows[:, 14], error
        )


def _beside(path: str | Path) -> Path:
    return Path(path).with_suffix(".error.npz")


_UPPER = np.triu_indices(3)
_COLUMNS = (
    *TUM_COLUMNS,
    *("var_xx_m2", "cov_xy_m2", "cov_xz_m2", "var_yy_m2", "cov_yz_m2", "var_zz_m2"),
    "health",
)
