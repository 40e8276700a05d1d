"""Change between two fitted terrain models, with errors from their posteriors."""

from collections.abc import Mapping

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core.arrays import FloatArray
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.core.map_scale import areal_factors
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.base import ELEVATION
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.scoring.change.notes import datum_notes, scale_notes
from survey.scoring.change.results import SIGNIFICANT, Change, VolumeChange, significance


def change_of_models(
    later: GaussianProcessTerrain,
    earlier: GaussianProcessTerrain,
    outlines: Mapping[str, Polygon | MultiPolygon],
    grid: Grid,
) -> Change:
    """Compute the change between two fitted terrain models, with errors from their posteriors.

    Parameters
    ----------
    later, earlier : GaussianProcessTerrain
        Of the elevation, in one CRS, above one datum.
    outlines : mapping of str to polygon
        Polygons to integrate over [m]; within both sites.
    grid : Grid
        On which the difference is mapped; its step is that of the volumes too. Volumes and areas count on
        the ground, by the scale factors of its CRS.

    Returns
    -------
    Change
        With the method ``joint posterior``.

    Raises
    ------
    InputError
        Other quantities, mixed datums, an outline outside a site.

    Notes
    -----
    The surveys' errors are assumed to be independent: those of a prior surface that both share count twice,
    and drift of the positions that is not in the points' covariances is not included.
    """
    if {later.quantity, earlier.quantity} != {ELEVATION}:
        raise InputError(
            f"the models map {later.quantity} and {earlier.quantity}; change is computed of {ELEVATION}."
        )
    same_vertical_datum(later.vertical_datum_, earlier.vertical_datum_, "the two surveys")
    new, old = later.grid(grid), earlier.grid(grid)
    difference = new.mean.elevation - old.mean.elevation
    std = np.hypot(new.std.elevation, old.std.elevation)
    volumes = tuple(
        _volume(later, earlier, name, polygon, grid, base_m=float(np.nanmean(old.mean.elevation)), std_m=std)
        for name, polygon in outlines.items()
    )
    compared = Dem.on(grid, difference, later.vertical_datum_)
    notes = (
        *datum_notes(later.vertical_datum_, earlier.vertical_datum_),
        *scale_notes(compared),
    )
    return Change(compared, std, significance(difference, std), volumes, "joint posterior", notes=notes)


def _volume(
    later: GaussianProcessTerrain,
    earlier: GaussianProcessTerrain,
    name: str,
    polygon: Polygon | MultiPolygon,
    grid: Grid,
    *,
    base_m: float,
    std_m: FloatArray,
) -> VolumeChange:
    """Integrate both posteriors over an outline; a base near the surface keeps the sums small."""
    new, old = (
        model.volume(polygon, base_m=base_m, step_m=grid.step_m, crs=grid.crs) for model in (later, earlier)
    )
    found = new.minus(old)
    inside = shapely.contains_xy(polygon, *grid.xy.T).reshape(grid.shape)
    cells_m2 = grid.step_m**2 / areal_factors(grid.crs, grid.x, grid.y)[inside]
    naive_std_m3 = float(np.sqrt(((std_m[inside] * cells_m2) ** 2).sum()))
    return VolumeChange(
        name,
        found.area_m2,
        1.0,
        found.mean_m3 / found.area_m2,
        found.mean_m3,
        found.std_m3,
        SIGNIFICANT * found.std_m3,
        naive_std_m3,
    )
