"""Maps to be judged: firnline's own folders, or any raster."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from survey import Dem, Reconstruction


def map_of(source: Path, crs: str | None = None, epoch_s: float | None = None) -> "Reconstruction | Dem":
    """Read firnline's own map from its folder, or anyone's raster; a second band is its standard deviation.

    A map of moving ice is moved to an epoch where one is named.
    """
    import numpy as np

    import survey
    from survey.data.ice_motion import ICE_MOTION, read_motion
    from survey.io.raster import band_count
    from survey.reconstruction.motion.epoch import at_epoch
    from survey.reconstruction.terrain_map import INTERPOLATED

    if source.is_dir():
        own = survey.Reconstruction.read(source)
        if epoch_s is None:
            return own
        return at_epoch(own, read_motion(source / ICE_MOTION), epoch_s)[0]
    mean = survey.Dem.read(source, crs=crs)
    if band_count(source) < 2:
        return mean
    std = survey.Dem.read(source, band=2, crs=crs)
    return survey.Reconstruction(mean, std, np.full(mean.shape, INTERPOLATED), "outside", {})
