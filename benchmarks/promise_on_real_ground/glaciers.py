"""Complete outlines of glaciers: a class is promised or refused, in how much CPU time.

Hintereisferner has a real prior of 90 m (SRTM), resampled to 20 m as a product of finer cells would be. South
Glacier has an outline alone: its prior is a drawn surface of the same relief in 20 m cells.
"""

import time
from dataclasses import dataclass

import geopandas
import numpy as np
import rasterio
from affine import Affine
from rasterio.warp import Resampling, reproject

from benchmarks.promise_on_real_ground.windows import FOLDER, SEED
from planners.guarantee.guarantee import guarantee
from planners.guarantee.requirement import MapRequirement
from survey import Dem, Grid, SurveyArea
from survey.core.streams import stream
from survey.terrain import random_dem

_CRS = "EPSG:32632"
_HINTEREISFERNER = "RGI50-11.00897"
_DATA = "dem_oggm_glaciers"


@dataclass(frozen=True)
class Promised:
    """Whether a class was promised for a glacier, by how many swaths, in how much CPU time [s]."""

    promised: bool
    n_swaths: int
    reachable_m: float
    cpu_s: float


def promised(name: str, cell_m: float) -> Promised:
    """Ask for Class 3 with 90 % on a complete glacier, with a prior of some cell width [m]."""
    area, prior = _hintereisferner(cell_m) if name == "Hintereisferner" else _south_glacier(cell_m)
    start = time.process_time()
    made = guarantee(area, prior, MapRequirement(0.4572, surface="bare-ice", micro_relief_m=0.2))
    return Promised(made.holds, int(made.config.swaths or 0), made.reachable_m, time.process_time() - start)


def _outline(file: str, crs: str, rgi_id: str | None = None) -> SurveyArea:
    """Return the outline of one glacier of a file, or the only one."""
    table = geopandas.read_file(FOLDER / _DATA / "outlines" / file)
    if rgi_id is not None:
        table = table[table["RGIId"] == rgi_id]
    return SurveyArea(table.to_crs(crs).geometry.iloc[0], crs)


def _hintereisferner(cell_m: float) -> tuple[SurveyArea, Dem]:
    """Return outline and real prior of Hintereisferner."""
    area = _outline("rgi_oetztal.shp", _CRS, _HINTEREISFERNER)
    xmin, ymin, xmax, ymax = area.bounds
    columns, rows = (int(np.ceil(side / cell_m)) + 4 for side in (xmax - xmin, ymax - ymin))
    transform = Affine(cell_m, 0.0, xmin - 2.0 * cell_m, 0.0, -cell_m, ymax + 2.0 * cell_m)
    heights = np.full((rows, columns), np.nan)
    with rasterio.open(FOLDER / _DATA / "hintereisferner_srtm_90m.tif") as file:
        reproject(
            file.read(1).astype(np.float64),
            heights,
            src_transform=file.transform,
            src_crs=file.crs,
            dst_transform=transform,
            dst_crs=_CRS,
            dst_nodata=np.nan,
            resampling=Resampling.cubic,
        )
    return area, Dem(heights, transform, _CRS)


def _south_glacier(cell_m: float) -> tuple[SurveyArea, Dem]:
    """Return the outline of South Glacier with a drawn surface."""
    crs = "EPSG:32607"
    area = _outline("SouthGlacier.shp", crs)
    xmin, ymin, xmax, ymax = area.bounds
    grid = Grid.over(
        (xmin - 2 * cell_m, ymin - 2 * cell_m, xmax + 2 * cell_m, ymax + 2 * cell_m), cell_m, crs
    )
    rng = stream(SEED, "south glacier")
    drawn = random_dem("squared-exponential", grid, rng, 150.0, length_scale_m=600.0)
    rough = random_dem("matern-3/2", grid, rng, 6.0, length_scale_m=120.0)
    return area, Dem(drawn.elevation + rough.elevation, drawn.transform, drawn.crs)
