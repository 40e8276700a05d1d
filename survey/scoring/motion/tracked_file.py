"""Files of tracked displacements."""

from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.crs.checks import projected_crs
from survey.core.errors import InputError
from survey.io.vector import read_features
from survey.io.vector.writing import write_features
from survey.scoring.motion.tracking import TrackedMotion

_COLUMNS = ("east_m", "north_m", "sigma_east_m", "sigma_north_m", "correlation", "outlier", "window_m")


def write_tracked(path: str | Path, found: TrackedMotion, days: float, crs: CRS) -> None:
    """Write displacements as points with velocities and standard deviations.

    Parameters
    ----------
    path : str or pathlib.Path
        GeoPackage, GeoJSON or Shapefile.
    found : TrackedMotion
        Result of `survey.track`; the covariance between east and north is not written.
    days : float
        Time between the surveys [days].
    crs : pyproj.CRS
        Of the surveys.
    """
    columns = dict(zip(("east_m", "north_m"), found.shift_m.T, strict=True))
    columns |= dict(zip(("east_m_per_day", "north_m_per_day"), found.shift_m.T / days, strict=True))
    columns |= dict(zip(("sigma_east_m", "sigma_north_m"), found.sigma_m.T, strict=True))
    columns |= {"correlation": found.correlation, "outlier": found.is_outlier.astype(float)}
    columns |= {"window_m": np.full(len(found), found.window_m)}
    write_features(Path(path), shapely.points(found.xy), columns, crs, layer="velocity")


def read_tracked(path: str | Path, crs: CRS) -> TrackedMotion:
    """Read the displacements that `write_tracked` wrote.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    crs : pyproj.CRS
        Of the surveys, in which the file must be.

    Returns
    -------
    TrackedMotion
        Errors to the east and to the north count as independent.

    Raises
    ------
    InputError
        A file of other columns or in another CRS, or displacements that are not finite and not flagged.
    """
    features = read_features(path, what="the tracked displacements")
    lacking = [name for name in _COLUMNS if name not in features.attributes]
    if lacking:
        raise InputError(
            f"{path} has no column {', '.join(lacking)}; name a file that firnline track wrote, or track again."
        )
    same_crs(crs, projected_crs(features.crs, str(path)), "the surveys and the tracked displacements")
    east, north, sigma_east, sigma_north, correlation, outlier, window = (
        _numbers(features.attributes[name]) for name in _COLUMNS
    )
    covariance = np.zeros((len(east), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = sigma_east**2, sigma_north**2
    xy = shapely.get_coordinates(features.geometry)
    is_outlier = (outlier != 0.0) | ~np.isfinite(covariance).all(axis=(1, 2))
    shift = np.column_stack([east, north])
    _require_finite(path, shift[~is_outlier], window)
    return TrackedMotion(xy, shift, covariance, correlation, is_outlier, float(window[0]))


def _require_finite(path: str | Path, shift: FloatArray, window: FloatArray) -> None:
    """Refuse displacements or windows that are not finite."""
    n_bad = int((~np.isfinite(shift).all(axis=1)).sum())
    if n_bad:
        raise InputError(
            f"{path} holds {n_bad} displacements that are NaN or infinite and not flagged; set their column outlier to 1."
        )
    if not np.isfinite(window).all():
        raise InputError(f"{path} has windows whose window_m is NaN or infinite; track again.")


def _numbers(values: FloatArray) -> FloatArray:
    return np.asarray(values, dtype=np.float64)
