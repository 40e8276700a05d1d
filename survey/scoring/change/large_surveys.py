"""Surveys that are too large for a change in memory, averaged over squares of cells."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.crs.agreement import agreed_crs
from survey.data.dem import Dem
from survey.io.raster import band_count, raster_header
from survey.io.raster.large.averaging import read_averaged
from survey.reconstruction.base import INTERPOLATED, Reconstruction
from survey.scoring.change.variogram import LARGEST_CELLS

_AVERAGED_CELLS = 4_000_000


def averaged_step_m(files: list[Path]) -> float | None:
    """Return the side of the squares over which surveys are averaged before they are compared [m].

    Parameters
    ----------
    files : list of pathlib.Path
        North-up rasters with square cells.

    Returns
    -------
    float or None
        None where every survey is small enough to be compared cell by cell.
    """
    headers = [raster_header(file) for file in files]
    if all(math.prod(header.shape) <= LARGEST_CELLS for header in headers):
        return None
    sides = [math.prod(header.shape) * header.transform.a**2 / _AVERAGED_CELLS for header in headers]
    return float(max(np.sqrt(sides).max(), *(header.transform.a for header in headers)))


def averaged_survey(file: Path, step_m: float, crs: Any = None) -> Reconstruction | Dem:
    """Return a survey averaged over squares of about a given side; a second band is its standard deviation.

    Parameters
    ----------
    file : pathlib.Path
        A raster of any size, read in strips.
    step_m : float
        Side of the squares [m]; whole cells are taken, at least one.
    crs : str or pyproj.CRS, optional
        Of a file that carries none.

    Returns
    -------
    Dem or Reconstruction
        The standard deviation is the mean one of a square: it states where errors are larger than elsewhere, and not how
        large those of averages are.

    Raises
    ------
    InputError
        A damaged raster, one that is rotated or in degrees.
    """
    cells = max(1, math.ceil(step_m / raster_header(file).transform.a - 1e-9))
    bands = (1, 2) if band_count(file) > 1 else (1,)
    rasters = read_averaged(file, cells, bands)
    system = agreed_crs(rasters[0].crs, crs, str(file))
    mean, *std = (Dem(one.values, one.transform, system, one.vertical_datum) for one in rasters)
    if not std:
        return mean
    return Reconstruction(mean, std[0], np.full(mean.shape, INTERPOLATED), "outside", {})
