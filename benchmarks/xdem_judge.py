"""What xdem makes of the same pair of elevation models: statistics of the difference, and the shift."""

import contextlib
import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from survey.data.dem import Dem
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.differencing.coregistration import coregister

if TYPE_CHECKING:
    import xdem

TRUE_SHIFT_M = (5.3, -3.1, 1.7)


def shifted_pair(data: Path) -> tuple[Dem, Dem]:
    """Real lidar ground, and the same displaced by `TRUE_SHIFT_M`, with 0.1 m of noise; 4 m cells."""
    ground = Dem.read(data / "dem_slovenia_lidar_1m" / "TM1_564_146.tif").block_mean(4.0)
    xmin, ymin, xmax, ymax = ground.bounds
    reference = ground.window((xmin + 50.0, ymin + 50.0, xmax - 50.0, ymax - 50.0))
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(reference.xy))
    heights = ground.at(reference.xy + TRUE_SHIFT_M[:2]) - TRUE_SHIFT_M[2] + noise
    moving = Dem(heights.reshape(reference.shape), reference.transform, reference.crs)
    return moving, reference


def agreement(data: Path) -> tuple[float, float, float]:
    """Return how far statistics (relative), shift from xdem's [m] and shift from the true one [m] are apart at most."""
    moving, reference = shifted_pair(data)
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        import geoutils
        import xdem

        theirs = [_theirs(dem) for dem in (moving, reference)]
        difference = theirs[0] - theirs[1]
        stats = difference.get_stats()
        nmad = float(geoutils.stats.nmad(np.ma.filled(difference.data.astype(np.float64), np.nan)))
        fitted = xdem.coreg.NuthKaab()
        fitted.fit(theirs[1], theirs[0])
        affine = fitted.meta["outputs"]["affine"]
    ours = ErrorStatistics.of(moving.elevation - reference.elevation)
    pairs = (
        (ours.bias_m, stats["Mean"]),
        (ours.median_m, stats["Median"]),
        (ours.rmse_m, stats["RMSE"]),
        (ours.std_m, stats["Standard deviation"]),
        (ours.nmad_m, nmad),
    )
    apart = max(abs(a / float(b) - 1.0) for a, b in pairs)
    shift = coregister(moving, reference)
    found = np.array([shift.east_m, shift.north_m, shift.up_m])
    judged = np.array([affine[name] for name in ("shift_x", "shift_y", "shift_z")], dtype=np.float64)
    return apart, float(np.abs(found - judged).max()), float(np.abs(found - TRUE_SHIFT_M).max())


def _theirs(dem: Dem) -> "xdem.DEM":
    import xdem

    return xdem.DEM.from_array(
        dem.elevation.astype(np.float64), dem.transform, dem.crs.to_wkt(), nodata=-9999
    )
