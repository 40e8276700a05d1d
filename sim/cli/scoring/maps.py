"""Maps to be judged: firnline's own folders, or any raster."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from survey import Dem, Reconstruction


def map_of(source: Path, crs: str | None = None) -> "Reconstruction | Dem":
    """Read firnline's own map from its folder, or anyone's raster; a second band is its standard deviation."""
    import numpy as np

    import survey
    from survey.io.raster import band_count
    from survey.reconstruction import INTERPOLATED

    if source.is_dir():
        return survey.Reconstruction.read(source)
    mean = survey.Dem.read(source, crs=crs)
    if band_count(source) < 2:
        return mean
    std = survey.Dem.read(source, band=2, crs=crs)
    return survey.Reconstruction(mean, std, np.full(mean.shape, INTERPOLATED), "outside", {})
