"""Plans and guarantees over 100 km², and fleets of ten: time and memory."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import CRS_NAME, MadeSurvey
from benchmarks.whole_glacier.mapping import used_by
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid

_SIDE_M, _STEP_M, _MARGIN_M = 10_000.0, 30.0, 310.0
_SEED = 101
_MOST_S, _MOST_MB = 600.0, 4000.0
_PLANS = {
    "plan, swaths of 100 m": ("--spacing", "100"),
    "plan, ten rovers": ("--spacing", "100", "--rovers", "10"),
    "guarantee of 2 m": ("--require", "2.0", "--max-swaths", "100"),
}


def planned(folder: Path) -> Iterator[Row]:
    """Yield time and memory of plans over a square of 100 km² with a prior of 30 m."""
    area, prior = _site(folder)
    for name, options in _PLANS.items():
        out = folder / f"{len(list(folder.iterdir()))}.geojson"
        arguments = ["plan", str(area), "--prior", str(prior), *options, "--out", str(out)]
        used = used_by([sys.executable, "-m", "firnline.cli.main", *arguments])
        yield Row.of(f"100 km², {name}: CPU time", used.cpu_s, "s", "<=", _MOST_S)
        yield Row.of(f"100 km², {name}: memory", used.memory_mb, "MB", "<=", _MOST_MB)


def _site(folder: Path) -> tuple[Path, Path]:
    """Write a square outline and a coarse raster of gentle made ground about it, and return their files."""
    west, south = 500_000.0, 6_500_000.0
    box = shapely.box(west, south, west + _SIDE_M, south + _SIDE_M)
    start = np.array([[west + 0.5 * _SIDE_M, south + _MARGIN_M]])
    SurveyArea(box, CRS(CRS_NAME), starts=start).write(folder / "area.gpkg")
    about = (west - _MARGIN_M, south - _MARGIN_M, west + _SIDE_M + _MARGIN_M, south + _SIDE_M + _MARGIN_M)
    grid = Grid(about, _STEP_M, CRS_NAME)
    heights = MadeSurvey(_SEED, _SIDE_M, _SIDE_M).heights(*np.ascontiguousarray(grid.xy.T))
    Dem.on(grid, 0.2 * heights.reshape(grid.shape)).write(folder / "prior.tif")
    return folder / "area.gpkg", folder / "prior.tif"
