"""Columns of surface points in tables: places, covariances, and their projection into a survey's CRS."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import agreed_crs, is_local, same_crs
from survey.core.crs.checks import known_crs, projected_crs
from survey.core.crs.choice import chosen_crs
from survey.core.crs.exchanged_axes import refuse_degrees, refuse_exchanged
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.io.point_columns import PLACE, say_projected
from survey.io.points.table import PointTable

SIGMA = "sigma_z_m"
COVARIANCE = {
    "cov_xx_m2": (0, 0),
    "cov_xy_m2": (0, 1),
    "cov_xz_m2": (0, 2),
    "cov_yy_m2": (1, 1),
    "cov_yz_m2": (1, 2),
    "cov_zz_m2": (2, 2),
}
ORIGIN = ("origin_x_m", "origin_y_m", "origin_z_m")
OWN = {f"own_{name}": place for name, place in COVARIANCE.items()}


def places_of(columns: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    """Take the columns of a place out, and return it (N, 3), or None where one of them is missing."""
    if not all(name in columns for name in names):
        return None
    return np.column_stack([columns.pop(name) for name in names])


def projected_table(table: PointTable, crs: Any, where: str) -> PointTable:
    """Project places in degrees to the named CRS or to their UTM zone, and log it; leave metres as they are.

    Raises
    ------
    InputError
        A table in degrees with the sensor's places in metres of an unknown CRS, places beyond the CRS, or
        easting and northing that are exchanged or degrees.
    """
    stated = None if table.crs is None else known_crs(table.crs, where)
    if stated is None or not stated.is_geographic:
        _refuse_misplaced(table, stated or crs, where)
        return table
    if any(name in table.columns for name in ORIGIN):
        raise InputError(
            f"{where} has places in degrees and {ORIGIN[0]} in metres; write both in one projected CRS."
        )
    x, y = (table.columns[name] for name in PLACE[:2])
    target = chosen_crs(x, y) if crs is None else projected_crs(crs, where)
    east, north = transformed(np.column_stack([x, y]), stated, target, where).T
    say_projected(where, target)
    return table._replace(columns={**table.columns, PLACE[0]: east, PLACE[1]: north}, crs=target)


def _refuse_misplaced(table: PointTable, crs: Any, where: str) -> None:
    """Refuse a table whose easting and northing are exchanged or degrees; one without a CRS is refused later."""
    if crs is not None and not is_local(crs):
        places = np.column_stack([table.columns[name] for name in PLACE[:2]])
        refuse_exchanged(places, known_crs(crs, where), where)
        refuse_degrees(places, known_crs(crs, where), where)


def symmetric(columns: dict[str, FloatArray], names: Mapping[str, tuple[int, int]]) -> FloatArray:
    """Take the columns of a symmetric matrix out, and return it (N, 3, 3)."""
    entries = {name: columns.pop(name) for name in names}
    matrices = np.empty((len(next(iter(entries.values()))), 3, 3))
    for name, (i, j) in names.items():
        matrices[:, i, j] = matrices[:, j, i] = entries[name]
    return matrices


def uncertainty_of(
    columns: dict[str, FloatArray], sigma_m: float | None
) -> tuple[FloatArray | None, FloatArray | float | None]:
    """Take the columns of the uncertainty out, and return the covariance or the sigma."""
    found = [name for name in COVARIANCE if name in columns]
    sigma = columns.pop(SIGMA, None)
    if found and len(found) < len(COVARIANCE):
        missing = ", ".join(name for name in COVARIANCE if name not in found)
        raise InputError(f"the covariance lacks the columns {missing}; give all six or {SIGMA}.")
    if found:
        return symmetric(columns, COVARIANCE), None
    if sigma is None and sigma_m is None:
        raise InputError(
            f"the file states no uncertainty; add a column {SIGMA} or the six cov_*_m2, or name one sigma for all."
        )
    return None, sigma if sigma is not None else sigma_m


def one_crs(stated: Any, named: Any) -> CRS:
    """Return the CRS of the file or, where it has none, the one that was named."""
    if stated is None or named is None or is_local(stated):
        return agreed_crs(stated, named, "the set of surface points")
    of_file, wanted = (projected_crs(crs, "the set of surface points") for crs in (stated, named))
    same_crs(of_file, wanted, "the file and the request")
    return of_file
