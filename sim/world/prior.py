"""Prior elevations of a mission: cells made from the terrain with the errors of a product, or a raster."""

import numpy as np

from sim.config.mission import MissionConfig
from sim.config.terrain import SatelliteConfig
from survey.core.crs.choice import is_geographic
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.io.raster import Raster, raster_header, reprojected
from survey.terrain.product import ProductErrors, product_copy
from survey.terrain.satellite import SatelliteDem

_MARGIN_CELLS = 4.0


def erroneous_copy(
    terrain: Dem,
    satellite: SatelliteConfig,
    rng: np.random.Generator,
    errors_rng: np.random.Generator,
) -> SatelliteDem:
    """Return block means of a terrain with the errors that the settings draw.

    Parameters
    ----------
    terrain : Dem
        Fine terrain.
    satellite : SatelliteConfig
        Width of the cells, and their errors.
    rng, errors_rng : numpy.random.Generator
        For the white error, and for all others.

    Returns
    -------
    SatelliteDem
        The cells.
    """
    errors = ProductErrors.drawn(satellite.errors(), errors_rng)
    return product_copy(terrain, errors, rng=rng, cell_m=satellite.cell_m, correlated_rng=errors_rng)


def prior_from_file(mission: MissionConfig, terrain: Dem, area: SurveyArea) -> Dem:
    """Read the prior that a mission names, in the terrain's CRS and about the area.

    Parameters
    ----------
    mission : MissionConfig
        Its section ``satellite``.
    terrain : Dem
        The real terrain.
    area : SurveyArea
        The area to survey.

    Returns
    -------
    Dem
        Cells of the raster's own width, resampled bilinearly where its projected CRS is another one.

    Raises
    ------
    InputError
        The raster is elsewhere, has voids in the area, or counts from another vertical datum.
    """
    config = mission.satellite
    assert config.file is not None
    file = mission.path(config.file)
    stated = raster_header(file).crs if config.crs is None else config.crs
    crs = terrain.crs if is_geographic(stated) else config.crs
    prior = Dem.read(file, crs=crs, vertical_datum=config.vertical_datum)
    same_vertical_datum(
        prior.vertical_datum, terrain.vertical_datum, "the satellite's raster and the terrain"
    )
    if not prior.crs.equals(terrain.crs, ignore_axis_order=True):
        warped = reprojected(
            Raster(prior.elevation, prior.transform, prior.crs, prior.vertical_datum),
            terrain.crs,
            prior.step_m,
        )
        prior = Dem(warped.values, warped.transform, terrain.crs, prior.vertical_datum)
    return _about(prior, area, config.file)


def _about(prior: Dem, area: SurveyArea, name: str) -> Dem:
    """Return the cells about an area; refuse a prior that does not cover it."""
    xmin, ymin, xmax, ymax = area.bounds
    corners = np.array([[xmin, ymin], [xmin, ymax], [xmax, ymin], [xmax, ymax]])
    nodes = prior.xy[area.contains(prior.xy)]
    heights = prior.at(np.vstack([corners, nodes]))
    if np.isnan(heights).any():
        raise InputError(
            f"satellite.file {name} has no height at {int(np.isnan(heights).sum())} of {len(heights)} places of the survey "
            "area; take a raster that covers it."
        )
    margin_m = _MARGIN_CELLS * prior.step_m
    return prior.window((xmin - margin_m, ymin - margin_m, xmax + margin_m, ymax + margin_m))
