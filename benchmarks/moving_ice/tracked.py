"""Feature tracking between two images of real ground of which one was carried on by known displacements.

Images are means over blocks of 3 × 3 cells of a 1 m raster; the second image begins some cells beside the first, so that
displacements are thirds of a pixel without any interpolation. Every survey has independent errors of 3 cm.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine

from benchmarks.report import Row
from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.scoring.differencing.tracking import track

BLOCK, PIXELS, EDGE = 3, 130, 24
FILES = (
    "dem_gully_fortbragg_3epochs/elevation_2012_1m.tif",
    "dem_gully_fortbragg_3epochs/elevation_2016_1m.tif",
    "dem_subarctic_alpine_granger_1m",
    "dem_gullies_santacruz_pozo",
)
"""Judged ground; the tracking was developed on `dem_slovenia_lidar_1m`."""
CELLS = tuple((k, (7 * k + 8) % 61) for k in range(0, 61, 4))
"""Displacements south and east in cells of a metre: 0 to 20 pixels."""
_NOISE_M = 0.03


def tracked(data: Path) -> dict[str, Any]:
    """Return errors [pixels], scores and outliers of all windows, and the share of false windows that were flagged."""
    errors, scores, outliers = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    for name in FILES:
        ground = _raster(data / name)
        for number, cells in enumerate(CELLS):
            found = _one(ground, cells, number)
            if found is None:
                continue
            error, score, outlier = found
            errors.append(error[~outlier])
            scores.append(score[~outlier])
            outliers.append(outlier)
    error, score = np.concatenate(errors), np.concatenate(scores)
    return {
        "n": len(error),
        "bias_px": [float(np.abs(error.mean(axis=0)).max())],
        "worst_bias_px": float(max(np.abs(one.mean(axis=0)).max() for one in errors if len(one) > 20)),
        "rms_px": float(np.sqrt(np.mean(error**2))),
        "score_sd": float(np.std(score)),
        "coverage": float(np.mean(np.abs(score) <= 1.959964)),
        "outlier_share": float(np.mean(np.concatenate(outliers))),
        "gross": float(np.mean(np.abs(error).max(axis=1) > 0.5)),
        "flagged": _flagged(_raster(data / FILES[0])),
    }


def rows(found: dict[str, Any]) -> Iterator[Row]:
    """Yield the rows of feature tracking."""
    yield Row("feature tracking: windows on real ground", float(found["n"]), "1")
    yield Row.of("feature tracking: bias", found["bias_px"][0], "px", "<=", 0.02)
    yield Row("feature tracking: largest bias of one pair of images", found["worst_bias_px"], "px")
    yield Row("feature tracking: RMS error", found["rms_px"], "px")
    held = 0.93 <= found["coverage"] <= 0.97
    yield Row("feature tracking: displacements within 95 %", found["coverage"], "1", "0.93 to 0.97", held)
    yield Row("feature tracking: standard deviation of errors over the claimed one", found["score_sd"], "1")
    yield Row("feature tracking: share of windows flagged as outliers", found["outlier_share"], "1")
    yield Row.of(
        "feature tracking: errors beyond half a pixel that are not flagged", found["gross"], "1", "<=", 0.001
    )
    yield Row.of(
        "feature tracking: windows of other ground that are flagged", found["flagged"], "1", ">=", 0.99
    )


def _raster(place: Path) -> FloatArray:
    """Return the heights of the largest 1 m raster of a place, without gaps."""
    files = [place] if place.is_file() else sorted(place.glob("*1m*.tif")) or sorted(place.glob("*.tif"))
    heights = Dem.read(files[0]).elevation
    rows, columns = np.isfinite(heights).any(axis=1), np.isfinite(heights).any(axis=0)
    inside: FloatArray = heights[np.ix_(rows, columns)]
    return inside


def _one(
    ground: FloatArray, cells: tuple[int, int], number: int
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Track one displacement; None where the ground is too small or has gaps."""
    first, second = (_image(ground, shift, number) for shift in ((0, 0), cells))
    if first is None or second is None:
        return None
    found = track(first, second, window_px=33, step_px=8, search_px=EDGE)
    real = np.array([cells[1], -cells[0]], dtype=np.float64)
    error = found.shift_m - real
    return error / BLOCK, error / found.sigma_m, found.is_outlier


def _image(ground: FloatArray, cells: tuple[int, int], number: int) -> Dem | None:
    """Return means over blocks of the ground that begins some cells up and to the left of the reference."""
    size, edge = BLOCK * PIXELS, max(max(pair) for pair in CELLS)
    row, column = edge - cells[0], edge - cells[1]
    part = ground[row : row + size, column : column + size]
    if part.shape != (size, size) or not np.isfinite(part).all():
        return None
    rng = np.random.default_rng([number, *cells])
    means = part.reshape(PIXELS, BLOCK, PIXELS, BLOCK).mean(axis=(1, 3))
    noisy = means + _NOISE_M * rng.standard_normal(means.shape)
    return Dem(noisy, Affine(BLOCK, 0.0, 0.0, 0.0, -BLOCK, size), "EPSG:32608")


def _flagged(ground: FloatArray) -> float:
    """Return the share of windows that are flagged where the second image is one of other ground."""
    first = _image(ground, (0, 0), 0)
    assert first is not None
    other = Dem(first.elevation[::-1, ::-1].T.copy(), first.transform, first.crs)
    found = track(first, other, window_px=33, step_px=8, search_px=EDGE)
    return float(np.mean(found.is_outlier))
