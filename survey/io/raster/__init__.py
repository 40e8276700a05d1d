"""Elevation rasters: reading with scale, units and nodata, and writing as GeoTIFF, ASCII grid or NetCDF."""

from survey.io.raster.opening import LARGEST_CELLS
from survey.io.raster.reading import (
    NODATA,
    Raster,
    RasterFacts,
    band_count,
    band_names,
    open_raster,
    raster_facts,
    raster_header,
    read_raster,
    read_window,
    sigma_band,
    stated_datum,
)
from survey.io.raster.writing import reproject, write_raster

__all__ = [
    "LARGEST_CELLS", "NODATA", "Raster", "RasterFacts", "band_count", "band_names", "open_raster",
    "raster_facts", "raster_header", "read_raster", "read_window", "reproject", "sigma_band",
    "stated_datum", "write_raster",
]  # fmt: skip
