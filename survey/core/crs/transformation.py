"""Transformation of coordinates and heights between reference systems, with the grids that it needs."""

import warnings
from typing import Any

import numpy as np
from pyproj import CRS, Transformer, datadir
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from survey.core.arrays import FloatArray, frozen
from survey.core.crs.checks import known_crs, projected_crs
from survey.core.crs.vertical_datum import ELLIPSOIDAL, VERTICAL_CRS
from survey.core.errors import InputError


def transformed(xy: FloatArray, source: Any, target: CRS, where: str) -> FloatArray:
    """Transform easting/northing or longitude/latitude (N, 2) into the target CRS.

    Refuses when PROJ has no path, or places a point outside what the target can show.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Easting and northing [m], or longitude and latitude [deg].
    source : str, int or pyproj.CRS
        Of `xy`.
    target : pyproj.CRS
        Of the result.
    where : str
        What carries the places, for the message.

    Returns
    -------
    (N, 2) ndarray
        Easting and northing, or longitude and latitude, in the target CRS.
    """
    origin = known_crs(source, where)
    try:
        transformer = Transformer.from_crs(origin, target, always_xy=True)
        east, north = transformer.transform(xy[:, 0], xy[:, 1], errcheck=True)
    except (CRSError, ProjError) as error:
        raise InputError(f"{where} cannot be transformed to {target.name}: {error}.") from error
    result: FloatArray = frozen(list(zip(east, north, strict=True)))
    return result.reshape(-1, 2)


class MissingGridError(InputError):
    """A change of vertical datum for which PROJ lacks its grids."""


def heights_transformed(
    xyz: FloatArray, crs: CRS, source_datum: str, target_datum: str, where: str
) -> FloatArray:
    """Transform heights (N, 3) from one vertical datum to another at places of a projected CRS [m].

    Parameters
    ----------
    xyz : (N, 3) ndarray
        Easting, northing, height [m].
    crs : pyproj.CRS
        Of easting and northing.
    source_datum, target_datum : str
        ``ellipsoidal height`` or a name of `VERTICAL_CRS`.
    where : str
        What carries the heights, for the message.

    Returns
    -------
    (N,) ndarray
        Heights above the target datum [m].

    Raises
    ------
    InputError
        An unknown datum; the grids that PROJ needs and does not have are named. Heights are
        never passed through unchanged instead.
    """
    if source_datum == target_datum:
        return xyz[:, 2]
    group = _operations(crs, source_datum, target_datum, where)
    missing = missing_grids(group)
    if not group.best_available or not group.transformers:
        place = datadir.get_user_data_dir()  # type: ignore[attr-defined]  # public, but not listed
        raise MissingGridError(
            f"{where}: heights cannot be taken from {source_datum!r} to {target_datum!r}, for PROJ lacks "
            f"{', '.join(missing) or 'an operation between them'}; install it into {place}."
        )
    east, north, up = xyz.T
    heights: FloatArray = frozen(group.transformers[0].transform(east, north, up)[2])
    if not np.isfinite(heights).all():
        raise InputError(
            f"{where}: {int((~np.isfinite(heights)).sum())} places lie outside the grid between {source_datum!r} and {target_datum!r}; cut them off."
        )
    return heights


def missing_grids(group: TransformerGroup) -> list[str]:
    """Return the names of the grids without which the operations of a group cannot run.

    Parameters
    ----------
    group : pyproj.transformer.TransformerGroup
        Operations between two systems.

    Returns
    -------
    list of str
        File names.
    """
    names = {
        grid.short_name for way in group.unavailable_operations for grid in way.grids if not grid.available
    }
    return sorted(names)


def lacking_grids(crs: Any = "EPSG:32608") -> dict[str, list[str]]:
    """Return, for every known vertical datum, the grids that PROJ lacks to reach it from the ellipsoid.

    Parameters
    ----------
    crs : str, int or pyproj.CRS
        A projected CRS of the region in question.

    Returns
    -------
    dict of str to list of str
        Names of grids by vertical datum; empty lists where nothing lacks.

    Examples
    --------
    >>> sorted(lacking_grids()) == sorted(VERTICAL_CRS)
    True
    """
    horizontal = projected_crs(crs, "the CRS")
    found = {}
    for datum in VERTICAL_CRS:
        group = _operations(horizontal, ELLIPSOIDAL, datum, "the check")
        found[datum] = [] if group.best_available and group.transformers else missing_grids(group)
    return found


def _operations(crs: CRS, source_datum: str, target_datum: str, where: str) -> TransformerGroup:
    """Return every way between two datums; rough guesses that leave heights as they are do not count."""
    source, target = (_with_datum(crs, datum, where) for datum in (source_datum, target_datum))
    with warnings.catch_warnings():
        # pyproj warns where the best way lacks its grid; that is what is asked here.
        warnings.simplefilter("ignore")
        return TransformerGroup(source, target, always_xy=True, allow_ballpark=False)


def _with_datum(crs: CRS, datum: str, where: str) -> CRS:
    if datum == ELLIPSOIDAL:
        return crs.to_3d()
    if datum not in VERTICAL_CRS:
        raise InputError(
            f"{where} names the vertical datum {datum!r}; one of {ELLIPSOIDAL}, {', '.join(VERTICAL_CRS)} can be transformed."
        )
    return CompoundCRS(f"{crs.name} + {datum}", [crs, CRS.from_user_input(VERTICAL_CRS[datum])])
