"""Velocity rasters of Kaskawulsh Glacier as prior of a survey: withheld cells, and the velocities of other dates."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Row
from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.reconstruction.motion.priors import VelocityRasters, motion_from_rasters

FOLDER = "ice_kaskawulsh_velocity"
_PARTS = ("vx", "vy", "errx", "erry")
# Sites have so many cells on a side; those of the middle, on which the survey lies, are withheld.
_SITE, _WITHHELD = 11, 3
_Z95 = 1.959964


def predicted(data: Path) -> dict[str, Any]:
    """Return the errors of the priors in standard deviations, against withheld cells and against other dates."""
    rasters = _rasters(data / FOLDER)
    found: dict[str, Any] = {"withheld": [], "others": [], "speed": []}
    for date, read in rasters.items():
        for row, column in _sites(read):
            xy = read.east.xy.reshape(*read.east.shape, 2)[row, column][None]
            rate, sigma = _prior(read, row, column)
            here = _at(read, xy)
            found["speed"].append(float(np.hypot(*here[:2])))
            found["withheld"] += ((here[:2] - rate) / sigma).tolist()
            others = [_at(other, xy) for name, other in rasters.items() if name != date]
            for other in others:
                if np.isfinite(other).all():
                    found["others"] += ((other[:2] - rate) / np.hypot(sigma, other[2:])).tolist()
    return found


def rows(found: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the rows of raster priors."""
    yield Row("velocity rasters as prior: sites on Kaskawulsh Glacier", float(len(found["speed"])), "1")
    yield Row("velocity rasters as prior: fastest site", max(found["speed"]), "m/day")
    for name, key in (("withheld cells", "withheld"), ("velocities of other months", "others")):
        within = float(np.mean(np.abs(found[key]) <= _Z95))
        yield Row(f"velocity rasters as prior: {name} within 95 %", within, "1")


def _rasters(folder: Path) -> dict[str, VelocityRasters]:
    """Return the rasters of all dates."""
    dates = sorted({file.name.rsplit("_", 1)[0] for file in folder.glob("*_vx.tif")})
    return {
        date: VelocityRasters(*(Dem.read(folder / f"{date}_{part}.tif") for part in _PARTS)) for date in dates
    }


def _sites(rasters: VelocityRasters) -> Iterator[tuple[int, int]]:
    """Yield the middle cells of sites beside one another without gaps."""
    known = np.all([np.isfinite(raster.elevation) for raster in rasters], axis=0)
    half = _SITE // 2
    for row in range(half, known.shape[0] - half, _SITE):
        for column in range(half, known.shape[1] - half, _SITE):
            if known[row - half : row + half + 1, column - half : column + half + 1].all():
                yield row, column


def _prior(rasters: VelocityRasters, row: int, column: int) -> tuple[FloatArray, FloatArray]:
    """Return the velocity (2,) in the middle of a site by the cells about it, and its standard deviations [m/day]."""
    given = VelocityRasters(*(_without_middle(raster, row, column) for raster in rasters))
    x, y = rasters.east.xy.reshape(*rasters.east.shape, 2)[row, column].tolist()
    reach = 0.5 * _WITHHELD * rasters.east.step_m
    motion = motion_from_rasters(
        given, (x - reach, y - reach, x + reach, y + reach), lowering_sigma=0.05, epoch_s=0.0
    )
    place = np.array([[x, y]])
    return motion.rates(place)[0, :2], motion.rates_sigma(place)[0, :2]


def _without_middle(raster: Dem, row: int, column: int) -> Dem:
    half, values = _WITHHELD // 2, raster.elevation.copy()
    values[row - half : row + half + 1, column - half : column + half + 1] = np.nan
    return Dem.on(raster.grid(), values)


def _at(rasters: VelocityRasters, xy: FloatArray) -> FloatArray:
    """Return velocities and standard deviations (4,) at a place [m/day]."""
    return np.array([raster.at(xy)[0] for raster in rasters])
