"""What xdem makes of the same pair of elevation models: statistics of the difference, and the shift."""

import contextlib
import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.dem import Dem
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.differencing.coregistration import align

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
    shift = align(moving, reference, only_shift=True).alignment
    found = np.array([shift.east_m, shift.north_m, shift.up_m])
    judged = np.array([affine[name] for name in ("shift_x", "shift_y", "shift_z")], dtype=np.float64)
    return apart, float(np.abs(found - judged).max()), float(np.abs(found - TRUE_SHIFT_M).max())


def _theirs(dem: Dem) -> "xdem.DEM":
    import xdem

    return xdem.DEM.from_array(
        dem.elevation.astype(np.float64), dem.transform, dem.crs.to_wkt(), nodata=-9999
    )


def aligned_difference(later: Dem, earlier: Dem, stable: BoolArray, *, has_plane: bool) -> FloatArray:
    """Return xdem's difference (H, W) on the cells of the later model: Nuth and Kääb, perhaps a plane, and a median.

    `stable` (H, W) bool: cells of the later model that did not change.
    """
    import xdem

    reference, moving = _theirs(later), _theirs(earlier)
    plane = [xdem.coreg.Deramp(poly_order=1)] if has_plane else []
    steps = xdem.coreg.CoregPipeline([xdem.coreg.NuthKaab(), *plane, xdem.coreg.VerticalShift()])
    moving = moving.reproject(reference)
    steps.fit(reference, moving, inlier_mask=stable, random_state=0)
    aligned = steps.apply(moving).reproject(reference)
    difference = np.ma.filled((reference.data - aligned.data).astype(np.float64), np.nan)
    return np.asarray(difference.squeeze())


def filled_mean(difference: FloatArray, heights: FloatArray, inside: BoolArray) -> float:
    """Return the mean of a difference over cells (H, W) whose voids are filled by xdem's hypsometric means [m]."""
    import xdem

    known = inside & np.isfinite(difference) & np.isfinite(heights)
    void = inside & np.isfinite(heights) & ~known
    total = float(difference[known].sum())
    if void.any():
        bins = xdem.volume.hypsometric_binning(
            difference[known], heights[known], bins=50.0, aggregation_function=np.mean
        )
        values = bins["value"].interpolate(limit_direction="both").to_numpy()
        index = bins.index.get_indexer(np.clip(heights[void], bins.index[0].mid, bins.index[-1].mid))
        total += float(values[index].sum())
    return total / float((known | void).sum())
