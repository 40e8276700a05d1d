"""Designed error of a mean change beside the actual one, on repeated elevation models.

``python -m benchmarks.season [--quick] [--json FILE]``

Both epochs of a pair are sampled along the same 3, 6 and 12 straight lines, in six directions with two distances from the
border, with errors of 2 cm; the mean change of a window follows by block kriging of the difference, as the season's design
takes it. Truth is the mean of all cells of the difference; the actual error is the root mean square over the twelve surveys.
Standard deviation and length of the change, and what no length explains (relief drawn anew), are those of all *other* windows
of the pair, from their pooled variogram. In rows "sized by the lines" the standard deviation is scaled by that of the
window's own samples, which is known after the first season; its length stays that of the other windows.

The pairs show erosion of gullies (Fort Bragg, 2004, 2012, 2016), the growth of a dome and the thickening of a glacier (Mount
St. Helens, 2004 to 2007), not melt: their changes are concentrated, where melt is even. What the default of a glacier states
(15 % of the melt, 150 m) is not judged by them, the arithmetic and the families are, whose weights were chosen here. Rows of
maps are of two maps of `reconstruct`, each with a covariance of its own, and their mean difference. Ten minutes of CPU.
"""

import sys
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.distance import cdist

from benchmarks.promise_on_real_ground.windows import FOLDER
from benchmarks.report import Row, main
from planners.patterns.lawnmower import LawnmowerConfig
from planners.planning import planned_on
from planners.prediction.places import places
from planners.routes.traversability import drivable
from planners.season import SurfaceChange, kriged_mean, mean_error
from survey import Dem, Grid, SurfacePoints, SurveyArea
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.reconstruction import reconstruct

NOISE_M = 0.02
_LINES = (3, 6, 12)
_HEADINGS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
_OUTER_SHARES = (0.35, 0.5)
_STEPS = 60
_NODES_ALONG = 25
_KNOWN, _LEAST_WINDOWS, _MOST_WINDOWS, _N_LAGS, _MOST_PLACES = 0.9, 3, 9, 12, 1200
_GULLIES, _CRATER = "dem_gully_fortbragg_3epochs/elevation_{}_1m.tif", "dem_volcano_msh_crater_series/{}"


class Pair(NamedTuple):
    """Two epochs of one ground, and the side of the windows [m]."""

    name: str
    earlier: Dem
    later: Dem
    side_m: float

    @property
    def difference(self) -> Dem:
        """Change of height on the cells of the later epoch [m]."""
        before = self.earlier.at(self.later.xy).reshape(self.later.shape)
        return Dem(self.later.elevation - before, self.later.transform, self.later.crs)


class Judged(NamedTuple):
    """Designed and actual error of the mean change [m], the designed one sized by the lines and those in each family."""

    pair: str
    n_lines: int
    designed_m: float
    actual_m: float
    sized_m: float
    families: dict[str, float]

    @property
    def ratio(self) -> float:
        """Designed over actual error."""
        return self.designed_m / self.actual_m


def pairs() -> Iterator[Pair]:
    """Yield the pairs; ground of the crater series that no survey saw again is left out."""
    for first, last in ((2004, 2012), (2012, 2016), (2004, 2016)):
        name, files = f"gullies {first} to {last}", (_GULLIES.format(first), _GULLIES.format(last))
        yield Pair(name, _dem(files[0]), _dem(files[1]), 150.0)
    before = _dem(_CRATER.format("msh_20000925_10m.tif")).elevation
    days = ("20041004", "20050201", "20050714", "20060209", "20070705")
    series = [_dem(_CRATER.format(f"merged10m_{day}.tif")) for day in days]
    seen = [Dem(np.where(d.elevation == before, np.nan, d.elevation), d.transform, d.crs) for d in series]
    for k in range(len(days) - 1):
        yield Pair(f"crater {days[k]} to {days[k + 1]}", seen[k], seen[k + 1], 300.0)
    for begin, end in (("1004", "1011"), ("1011", "1013"), ("1004", "1013")):
        fine = [_dem(_CRATER.format(f"msh_2004{day}_2m.tif")) for day in (begin, end)]
        yield Pair(f"crater 2004{begin} to 2004{end}", fine[0], fine[1], 100.0)


def _dem(name: str) -> Dem:
    return Dem.read(FOLDER / name)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of all pairs together, of each landscape, number of lines and pair, and of maps."""
    if not FOLDER.is_dir():
        sys.exit(f"the folder of real data {FOLDER} is not here; set FIRNLINE_DATA.")
    found: list[Judged] = []
    maps: list[float] = []
    for pair in list(pairs())[: 2 if quick else None]:
        windows = _windows(pair)
        if len(windows) < _LEAST_WINDOWS:
            continue
        chosen = np.linspace(0, len(windows) - 1, min(len(windows), _MOST_WINDOWS)).round().astype(int)
        for index in chosen.tolist():
            change = change_elsewhere(windows, index, pair.side_m)
            found += [_judged(pair, windows[index], change, n) for n in _LINES]
            if len(found) % (2 * len(_LINES)):
                maps.append(_by_maps(pair, windows[index], _LINES[1]) / found[-2].designed_m)
    yield Row("windows", len(found) // len(_LINES), "")
    yield from _rows("designed over actual error", found, is_judged=True)
    sized = [one._replace(designed_m=one.sized_m) for one in found]
    yield from _rows("sized by the lines over actual error", sized)
    for name in ("gullies", "crater"):
        yield from _rows(f"sized by the lines, {name}", [one for one in sized if one.pair.startswith(name)])
    for n_lines in _LINES:
        yield from _rows(f"{n_lines} lines", [one for one in found if one.n_lines == n_lines])
    for name in dict.fromkeys(one.pair for one in found):
        yield from _rows(name, [one for one in found if one.pair == name])
    for family in found[0].families:
        ratios = [one.families[family] / one.actual_m for one in found]
        yield Row(f"interpolation by {family} alone over actual error: median", float(np.median(ratios)), "x")
    rms = float(np.sqrt(np.mean(np.square(maps))))
    yield Row(f"difference of two maps, {_LINES[1]} lines: error over designed, rms", rms, "x")


def _rows(name: str, found: Sequence[Judged], *, is_judged: bool = False) -> Iterator[Row]:
    """Yield the tenths and the median of designed over actual error."""
    low, middle, high = np.quantile([one.ratio for one in found], [0.1, 0.5, 0.9]).tolist()
    if is_judged:
        yield Row.of(f"{name}, 10 %", low, "x", ">=", 0.7)
        yield Row.of(f"{name}, 90 %", high, "x", "<=", 1.5)
    else:
        yield Row(f"{name}, 10 %", low, "x")
        yield Row(f"{name}, 90 %", high, "x")
    yield Row(f"{name}, median", middle, "x")


def _windows(pair: Pair) -> list[Dem]:
    """Return the squares of the difference that are known nearly everywhere."""
    dem = pair.difference
    n = int(pair.side_m / dem.step_m)
    west, _, _, north = dem.bounds
    found = []
    for top in range(0, dem.shape[0] - n + 1, n):
        for left in range(0, dem.shape[1] - n + 1, n):
            if np.isfinite(dem.elevation[top : top + n, left : left + n]).mean() >= _KNOWN:
                x, y = west + left * dem.step_m, north - top * dem.step_m
                found.append(dem.window((x, y - pair.side_m, x + pair.side_m, y)))
    return found


def change_elsewhere(windows: Sequence[Dem], index: int, side_m: float) -> SurfaceChange:
    """Return what the change is like in all windows but one, by their pooled variogram."""
    edges = np.geomspace(windows[0].step_m, 0.7 * side_m, _N_LAGS)
    squares, counts = np.zeros(_N_LAGS - 1), np.zeros(_N_LAGS - 1)
    for number, window in enumerate(windows):
        if number == index:
            continue
        known = np.flatnonzero(np.isfinite(window.elevation))
        chosen = stream(5, "places", number).choice(known, min(len(known), _MOST_PLACES), replace=False)
        xy, z = window.xy[chosen], window.elevation.ravel()[chosen]
        bins = np.digitize(cdist(xy, xy), edges)
        half = 0.5 * np.square(z[:, None] - z)
        squares += [half[bins == k].sum() for k in range(1, _N_LAGS)]
        counts += [np.sum(bins == k) for k in range(1, _N_LAGS)]
    used = counts > 0
    return fitted_change(
        np.sqrt(edges[1:] * edges[:-1])[used], (squares / np.maximum(counts, 1))[used], side_m
    )


def fitted_change(lag_m: FloatArray, semivariance_m2: FloatArray, side_m: float) -> SurfaceChange:
    """Return the change whose semivariances are relatively nearest, in the first family."""
    best, least = SurfaceChange(0.0, side_m), np.inf
    for half_m in np.geomspace(lag_m[0], side_m, 40):
        unit = SurfaceChange(1.0, float(half_m))
        lost = 1.0 - unit.kernel(next(iter(unit.families))).covariance_of_lag(
            np.column_stack([lag_m, 0.0 * lag_m])
        )
        (fine, smooth), off = nnls(
            np.column_stack([np.ones_like(lost), lost]) / semivariance_m2[:, None], np.ones_like(lost)
        )
        if off < least:
            best, least = (
                SurfaceChange(float(np.sqrt(smooth)), float(half_m), 0.0, float(np.sqrt(0.5 * fine))),
                off,
            )
    return best


def _judged(pair: Pair, window: Dem, change: SurfaceChange, n_lines: int) -> Judged:
    """Return designed and actual error of one window, over all directions of the lines."""
    truth_m = float(np.nanmean(window.elevation))
    xmin, ymin, xmax, ymax = window.bounds
    # Midpoints of equal squares, so that their mean is that of the window.
    share = (np.arange(_NODES_ALONG) + 0.5) / _NODES_ALONG
    every = np.stack(
        np.meshgrid(xmin + share * (xmax - xmin), ymin + share * (ymax - ymin)), axis=-1
    ).reshape(-1, 2)
    nodes = every[np.isfinite(window.at(every))]
    noise_m = float(np.sqrt(2.0 * (NOISE_M**2 + change.redrawn_m**2)))
    kernel = change.kernel(next(iter(change.families)))
    expected_m2 = kernel.variance_m2 - float(kernel.covariance(nodes, nodes).mean()) + noise_m**2
    designed, sized, errors, families = [], [], [], []
    for heading_deg, outer_share in product(_HEADINGS_DEG, _OUTER_SHARES):
        xy, change_m = _samples(pair, window, n_lines, heading_deg, outer_share)
        found = mean_error(xy, nodes, change, noise_m)
        designed.append(float(np.hypot(found.interpolation_m, found.samples_m)))
        sized.append(designed[-1] * float(np.std(change_m)) / np.sqrt(expected_m2))
        families.append(found.families)
        errors.append(float(kriged_mean(xy, nodes, kernel, noise_m)[0] @ change_m) - truth_m)
    by_family = {name: _rms([one[name] for one in families]) for name in change.families}
    return Judged(pair.name, n_lines, _rms(designed), _rms(errors), _rms(sized), by_family)


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _samples(
    pair: Pair, window: Dem, n_lines: int, heading_deg: float, outer_share: float
) -> tuple[FloatArray, FloatArray]:
    """Return places (N, 2) along lines and the change (N,) that both surveys show there [m]."""
    area = SurveyArea.rectangle(window.bounds, window.crs)
    lines = LawnmowerConfig(swaths=n_lines, heading_deg=heading_deg, outer_share=outer_share)
    route = planned_on(drivable(area), area, lines)
    xy = places(route, pair.side_m / _STEPS)
    rng = stream(6, pair.name, int(window.bounds[0]), int(window.bounds[1]), n_lines, int(heading_deg))
    change_m = window.at(xy) + np.sqrt(2.0) * NOISE_M * rng.standard_normal(len(xy))
    known = np.isfinite(change_m)
    return xy[known], change_m[known]


def _by_maps(pair: Pair, window: Dem, n_lines: int) -> float:
    """Return the error of the mean difference of two maps, each made from its own survey along the same lines [m]."""
    xy, _ = _samples(pair, window, n_lines, 0.0, 0.5)
    xmin, ymin, xmax, ymax = window.bounds
    step_m = pair.side_m / 30.0
    grid = Grid((xmin + step_m, ymin + step_m, xmax - step_m, ymax - step_m), step_m, window.crs)
    maps = []
    for epoch in (pair.earlier, pair.later):
        z = epoch.at(xy)
        known = np.isfinite(z)
        points = SurfacePoints(np.column_stack([xy, z])[known], sigma_m=NOISE_M, crs=window.crs)
        maps.append(reconstruct(points, grid).mean.elevation)
    truth = window.at(grid.xy)
    known = np.isfinite(truth)
    return float((maps[1] - maps[0]).ravel()[known].mean() - truth[known].mean())


if __name__ == "__main__":
    main("Season", measure)
