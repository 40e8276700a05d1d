"""Transformation of coordinates and heights between reference systems, with the grids that it needs."""

import warnings
from typing import Any

from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from survey.core.arrays import FloatArray, frozen
from survey.core.crs.checks import known_crs, projected_crs
from survey.core.crs.vertical_datum import VERTICAL_CRS
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
        group = _operations(horizontal, datum)
        found[datum] = [] if group.best_available and group.transformers else missing_grids(group)
    return found


def _operations(crs: CRS, datum: str) -> TransformerGroup:
    """Return every operation from the ellipsoid to a vertical datum; ballpark ones that leave heights as they are do not count."""
    target = CompoundCRS(f"{crs.name} + {datum}", [crs, CRS.from_user_input(VERTICAL_CRS[datum])])
    with warnings.catch_warnings():
        # pyproj warns where the best operation lacks its grid; that is what is asked here.
        warnings.simplefilter("ignore")
        return TransformerGroup(crs.to_3d(), target, always_xy=True, allow_ballpark=False)
