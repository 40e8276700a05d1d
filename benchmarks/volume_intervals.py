"""Intervals of volume changes for errors from white to smooth: ``python -m benchmarks.volume_intervals``.

A glacier of 180 m radius on 1 x 1 km of 5 m cells; the errors of the difference are white, or white filtered by
a Gaussian of 0.5 to 16 cells, of 0.3 m standard deviation. The true deviation of the volume's error is that of
1,000 draws of the errors alone, that of the mean of the glacier less that of the ground around it. Structures
and weights were chosen on draws of other seeds (0 and 99).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from scipy.fft import irfft2, rfft2

from benchmarks.change_worlds import Judged, judged
from benchmarks.report import Row, main
from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs import projected_crs
from survey.core.map_scale import areal_factors, ground_area_m2
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.scoring.differencing.difference import change

_FIRST_SEED = 93_000
_FILTERS_CELLS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_N, _STEP_M, _SIGMA_M, _RADIUS_M = 200, 5.0, 0.3, 180.0
_GRID = Grid(
    (0.0, 0.0, (_N - 1) * _STEP_M, (_N - 1) * _STEP_M), _STEP_M, projected_crs("EPSG:32608", "the benchmark")
)
_OUTLINE = shapely.Point(500.0, 485.0).buffer(_RADIUS_M, quad_segs=32)
_N_TRUE = 1000


class _Outcome(NamedTuple):
    """One pair: what was judged, and its half width over that of a known deviation."""

    judged: Judged
    width: float


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    n_each = 8 if quick else 58
    everything = []
    for filter_cells in _FILTERS_CELLS:
        true_m3 = _true_std_m3(filter_cells, 200 if quick else _N_TRUE)
        seeds = range(_FIRST_SEED, _FIRST_SEED + n_each)
        found = [_pair(seed, filter_cells, true_m3) for seed in seeds]
        everything += found
        name = f"errors filtered by {filter_cells:g} cells"
        ratio = float(np.median([one.judged.std_m3 for one in found])) / true_m3
        yield Row(
            f"{name}: claimed / true standard deviation, median",
            ratio,
            "1",
            "0.8 to 1.25",
            0.8 <= ratio <= 1.25,
        )
        width = float(np.median([one.width for one in found]))
        yield Row.of(f"{name}: half width / true one, median", width, "1", "<=", 1.3)
        yield Row(
            f"{name}: 95 % interval holds", 100.0 * float(np.mean([one.judged.holds for one in found])), "%"
        )
    covered = 100.0 * float(np.mean([one.judged.holds for one in everything]))
    shown = f"all filters: 95 % interval holds ({len(everything)} pairs)"
    yield Row(shown, covered, "%", "93 to 97", 93.0 <= covered <= 97.0)


def _pair(seed: int, filter_cells: float, true_m3: float) -> _Outcome:
    """Compare two surveys of a glacier that sank unevenly."""
    rng = stream(seed, "volume intervals", str(filter_cells))
    x, y = np.meshgrid(_GRID.x, _GRID.y)
    sunk = np.where(_inside(), -3.0 + np.sin(x / 90.0) + 0.5 * np.cos(y / 60.0), 0.0)
    terrain = 100.0 + 0.1 * x + 8.0 * np.sin(y / 70.0)
    errors = 0.5 + _errors(rng, filter_cells)
    outline = {"glacier": _OUTLINE}
    found = change(Dem.on(_GRID, terrain + sunk + errors), Dem.on(_GRID, terrain), outline).volumes[0]
    ground = 1.0 / areal_factors(_GRID.crs, _GRID.x, _GRID.y)
    mean_m = np.average(sunk[_inside()], weights=ground[_inside()])
    return _Outcome(
        judged(found, float(mean_m) * ground_area_m2(_GRID.crs, _OUTLINE)),
        found.half_width_95_m3 / (1.959964 * true_m3),
    )


def _true_std_m3(filter_cells: float, n_draws: int) -> float:
    """Return the deviation of the volume's error, from draws of the errors alone [m³]."""
    rng = stream(_FIRST_SEED, "volume intervals, truth", str(filter_cells))
    inside = _inside()
    weights = np.where(inside, 1.0 / inside.sum(), -1.0 / (~inside).sum())
    means = [float((weights * _errors(rng, filter_cells)).sum()) for _ in range(n_draws)]
    return float(np.sqrt(np.mean(np.square(means)))) * ground_area_m2(_GRID.crs, _OUTLINE)


def _inside() -> BoolArray:
    inside: BoolArray = shapely.contains_xy(_OUTLINE, *_GRID.xy.T).reshape(_GRID.shape)
    return inside


def _errors(rng: np.random.Generator, filter_cells: float) -> FloatArray:
    """Draw white errors and filter them, on a raster twice as wide so that its edges do not meet."""
    m = 2 * _N
    squared = (np.fft.fftfreq(m)[:, None] ** 2 + np.fft.rfftfreq(m)[None] ** 2) * (
        2.0 * np.pi * filter_cells
    ) ** 2
    gain = np.exp(-0.5 * squared)
    mean_power = np.mean(np.c_[gain, gain[:, 1:-1]] ** 2)
    field: FloatArray = irfft2(rfft2(rng.standard_normal((m, m))) * gain, (m, m))[:_N, :_N]
    scaled: FloatArray = _SIGMA_M * field / np.sqrt(mean_power)
    return scaled


if __name__ == "__main__":
    main("Volume intervals", measure)
