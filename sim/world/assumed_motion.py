"""Prior of the motion of the ice: one velocity, or velocity rasters with their errors."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pyproj import CRS

from sim.config.ice import IceAssumptions
from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.data.dem import Dem
from survey.data.ice.motion import IceMotion
from survey.reconstruction.motion.priors import VelocityRasters, motion_from_rasters


def assumed_motion(
    assumed: IceAssumptions,
    epoch_s: float,
    places: FloatArray,
    crs: CRS,
    *,
    path_of: Callable[[str], Path] = Path,
) -> IceMotion:
    """Return the prior of the motion of the ice about a survey.

    Parameters
    ----------
    assumed : IceAssumptions
        One velocity with its standard deviation, or velocity rasters.
    epoch_s : float
        Epoch in seconds of the recording.
    places : (N, 2) ndarray
        Easting and northing of places of the survey, the start first [m].
    crs : pyproj.CRS
        Their CRS.
    path_of : callable
        Path of a file that the settings name.

    Returns
    -------
    IceMotion
        Prior of localization. That of rasters is a plane of each component through the cells about the places.

    Raises
    ------
    InputError
        Rasters in another CRS, or with fewer than six known cells about the survey.
    """
    if assumed.velocity_files is None:
        east, north = places[0].tolist()
        return assumed.prior(epoch_s, (east, north))
    rasters = VelocityRasters(*(Dem.read(path_of(file)) for file in assumed.velocity_files))
    for raster in rasters:
        same_crs(crs, raster.crs, "the survey and the rasters of the velocity")
    (xmin, ymin), (xmax, ymax) = np.min(places, axis=0).tolist(), np.max(places, axis=0).tolist()
    return motion_from_rasters(
        rasters,
        (xmin, ymin, xmax, ymax),
        lowering=assumed.lowering_m_per_day,
        lowering_sigma=assumed.lowering_sigma_m_per_day,
        epoch_s=epoch_s,
    )
