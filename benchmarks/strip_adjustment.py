"""Adjustment of overlapping strips of a cloud: ``python -m benchmarks.strip_adjustment``.

Drawn surveys of four strips, 90 m wide and 240 m long with 30 m of overlap, on ground with relief. Each strip has an offset, and more by
case: tilts and horizontal shifts, which the model has; a bend along the strip, plants in one strip, noise of another size or with
outliers, which it has not. The 95 % intervals of the strips' heights about their mean, and of the differences in the overlaps, are judged by
the true errors. Real strips are adjusted by the points in every second square of 40 m and judged in the others, also by triangles of
the other strip, which the adjustment does not use.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from benchmarks.change_pairs import DATA
from benchmarks.change_worlds import exponential_field
from benchmarks.report import Row, cpu_seconds, main
from benchmarks.whole_glacier.real_strips import above_triangles_m
from survey.core import FloatArray, root_mean_square
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.strip_adjustment import StripAdjustment, compare_strips

_WIDTH_M, _LENGTH_M, _APART_M, _N_STRIPS = 90.0, 240.0, 60.0, 4
_CRS, _SIGMA_M, _PER_M2 = "EPSG:32608", 0.04, 2.0
_FIRST_SEED = 83_000
_SQUARE_M, _LEAST_BLOCKS, _EVERY = 40.0, 5, 7
_REAL = {
    "gullied hill": "dem_gullies_santacruz_pozo/Blanca_in_Pozo_cl2_SC12.laz",
    **{f"wooded slope {k}": f"lidar_bcts_3strips/bcts_{k}.laz" for k in range(1, 5)},
    "steep forest": "lidar_coromandel_2strips/points.laz",
}


class _Case(NamedTuple):
    """What a survey is like, and the least coverage [%] that is expected.

    `offset_m`, `tilt_m`, `shift_m`: standard deviations of the strips' errors, a tilt by its size at the strip's end. `bend_m`: of a
    bend along the strip. `slope_deg`: of the ground. `noise`: of the second strip over that of the others. `plants`: share of squares
    of 10 m in which the second strip alone sees plants of 0.1 to 0.4 m. `outliers`: share of points that are 1 m off.
    """

    name: str
    least: float | None = 90.0
    offset_m: float = 0.08
    tilt_m: float = 0.0
    shift_m: float = 0.0
    bend_m: float = 0.0
    slope_deg: float = 0.0
    per_m2: float = _PER_M2
    noise: float = 1.0
    plants: float = 0.0
    outliers: float = 0.0


_CASES = (
    _Case("offsets on level ground"),
    _Case("no errors of strips", offset_m=0.0),
    _Case("slope of 30°", slope_deg=30.0),
    _Case("tilts of 0.05 m", tilt_m=0.05),
    _Case("horizontal shifts of 0.2 m, slope of 30°", shift_m=0.2, slope_deg=30.0),
    _Case("second strip four times as noisy", noise=4.0),
    _Case("0.1 points per m²", per_m2=0.1),
    _Case("2 % of the points 1 m off", outliers=0.02),
    _Case("bends of 0.03 m along the strips", None, bend_m=0.03),
    _Case("plants on a tenth of one strip", None, plants=0.1),
    _Case("plants on four tenths of one strip", None, plants=0.4),
)


class _Survey(NamedTuple):
    """Points of a drawn survey, number of the strip of each, its error in height [m], and the slope northwards [m/m]."""

    points: SurfacePoints
    strip: FloatArray
    error_m: FloatArray
    slope: float


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    for case in _CASES:
        yield from _coverage(case, 4 if quick else 40)
    for name, file in _REAL.items():
        if (DATA / file).exists():
            yield from _real(name, DATA / file)


def _coverage(case: _Case, n: int) -> Iterator[Row]:
    """Yield coverage of heights and differences, the errors of heights before and after, and how often an error is named."""
    judged = [_judged(case, seed) for seed in range(_FIRST_SEED, _FIRST_SEED + n)]
    offsets, differences = (100.0 * float(np.mean([one[k] for one in judged])) for k in (0, 1))
    holds = None if case.least is None else min(offsets, differences) >= case.least
    bar = "" if case.least is None else f">= {case.least:g}"
    yield Row(
        f"{case.name}: 95 % intervals of the strips' heights hold ({n} surveys)", offsets, "%", bar, holds
    )
    yield Row(
        f"{case.name}: 95 % intervals of the differences in the overlaps hold", differences, "%", bar, holds
    )
    yield Row(
        f"{case.name}: σ of a strip's height, median", float(np.median([one[2] for one in judged])), "m"
    )
    before, after = (np.array([one[k] for one in judged]) for k in (3, 4))
    yield Row(f"{case.name}: errors of heights about their mean before, RMS", root_mean_square(before), "m")
    yield Row(f"{case.name}: after, RMS", root_mean_square(after), "m")
    yield Row(f"{case.name}: after, 95 % of the surveys", float(np.quantile(after, 0.95)), "m")
    within = 100.0 * np.array([one[6] for one in judged])
    yield Row(f"{case.name}: heights within the 95 % intervals that the map adds", float(within.mean()), "%")
    yield Row(f"{case.name}: in the worst survey", float(within.min()), "%")
    named = 100.0 * float(np.mean([one[5] for one in judged]))
    yield Row(f"{case.name}: surveys in which an error is named", named, "%")


def _judged(case: _Case, seed: int) -> tuple[list[bool], list[bool], float, float, float, bool, float]:
    """Return whether the intervals of a survey hold, and figures of it.

    They are the median σ [m], the errors before and after [m], if an error is named, and the share of heights within the intervals.
    """
    drawn = _drawn(case, seed)
    found = compare_strips(drawn.points)
    assert found is not None
    numbers = np.arange(_N_STRIPS)
    true_m = np.array([drawn.error_m[drawn.strip == k].mean() for k in numbers])
    height_m, sigma_m = found.heights_m()
    held = np.abs(height_m - (true_m - true_m.mean())) <= 1.96 * sigma_m
    apart = [_apart(found, drawn, first, second) for first, second in pairwise(numbers)]
    moved = drawn.points.xyz - found.adjusted(drawn.points).xyz
    after_m = drawn.error_m - moved[:, 2] + drawn.slope * moved[:, 1] - true_m.mean()
    some = np.arange(0, len(after_m), _EVERY)
    slope = np.tile([0.0, drawn.slope], (len(some), 1))
    within = np.abs(after_m[some]) <= 1.96 * np.sqrt(found.variance_m2(some, drawn.points.xy[some], slope))
    spread = (root_mean_square(each - each.mean()) for each in (drawn.error_m, after_m))
    is_named = "--adjust-strips" in found.sentence(is_adjusted=False)
    return held.tolist(), apart, float(np.median(sigma_m)), *spread, is_named, float(within.mean())


def _apart(found: StripAdjustment, drawn: _Survey, first: int, second: int) -> bool:
    """Return whether the difference of two strips in their overlap lies within its 95 % interval."""
    x = _APART_M * second + 0.5 * (_WIDTH_M - _APART_M)
    near = np.abs(drawn.points.xy[:, 0] - x) < 0.5 * (_WIDTH_M - _APART_M)
    true_m = [drawn.error_m[near & (drawn.strip == k)].mean() for k in (first, second)]
    pair = next(
        p for p in found.facts(is_adjusted=False)["overlaps"] if p["strips"] == [str(first), str(second)]
    )
    return bool(abs(pair["height_m"] - (true_m[0] - true_m[1])) <= 1.96 * pair["height_m_sigma"])


def _drawn(case: _Case, seed: int) -> _Survey:
    """Draw a survey."""
    rng = stream(seed, "strips", case.name)
    relief = 0.3 * exponential_field(rng, 300, 20.0)
    parts = [_strip(case, rng, relief, k) for k in range(_N_STRIPS)]
    xyz = np.concatenate([part[0] for part in parts])
    strip = np.repeat(np.arange(float(_N_STRIPS)), [len(part[0]) for part in parts])
    points = SurfacePoints(xyz, sigma_m=_SIGMA_M, values={"strip": strip}, crs=_CRS)
    return _Survey(points, strip, np.concatenate([part[1] for part in parts]), _slope(case))


def _strip(
    case: _Case, rng: np.random.Generator, relief: FloatArray, number: int
) -> tuple[FloatArray, FloatArray]:
    """Draw the points (N, 3) of a strip [m], and its error in height at them (N,), that of a horizontal shift on the slope included [m]."""
    n = int(case.per_m2 * _WIDTH_M * _LENGTH_M)
    own = rng.uniform(0.0, 1.0, (n, 2)) * [_WIDTH_M, _LENGTH_M]
    xy = own + [_APART_M * number, 0.0]
    z = map_coordinates(relief, xy.T, order=1, mode="reflect") + _slope(case) * xy[:, 1]
    across, along = (2.0 * own / [_WIDTH_M, _LENGTH_M] - 1.0).T
    size = rng.standard_normal(4) * [
        case.offset_m,
        case.tilt_m * _WIDTH_M / _LENGTH_M,
        case.tilt_m,
        case.bend_m,
    ]
    error_m = size[0] + size[1] * across + size[2] * along + size[3] * np.sin(4.0 * along + number)
    noise_m = _SIGMA_M * (case.noise if number == 1 else 1.0) * rng.standard_normal(n)
    wrong_m = np.where(rng.random(n) < case.outliers, 1.0, 0.0)
    if number == 1:
        squares = np.where(rng.random((40, 40)) < case.plants, rng.uniform(0.1, 0.4, (40, 40)), 0.0)
        wrong_m += squares[tuple((xy // 10.0).astype(np.int64).T)]
    shift_m = case.shift_m * rng.standard_normal(2)
    seen = np.column_stack([xy + shift_m, z + error_m + noise_m + wrong_m])
    return seen, error_m - _slope(case) * shift_m[1]


def _slope(case: _Case) -> float:
    """Return the slope northwards [m/m]."""
    return float(np.tan(np.deg2rad(case.slope_deg)))


def _real(name: str, file: Path) -> Iterator[Row]:
    """Yield the differences of real strips in squares that were not used, before and after."""
    points = SurfacePoints.read(file, sigma_m=0.05)
    square = np.floor(points.xy / _SQUARE_M).astype(np.int64).sum(axis=1) % 2
    used, judged = points.select(square == 0), points.select(square == 1)
    found, seconds = cpu_seconds(lambda: compare_strips(used))
    assert found is not None
    strip = judged.values["strip"].astype(np.int64)
    after = replace(found, strip=strip).adjusted(judged)
    for when, cloud in (("before", judged), ("after", after)):
        compared = compare_strips(cloud)
        assert compared is not None
        yield Row(
            f"{name}: strips differ in blocks that were not used, {when}, RMS", compared.rms_m()[0], "m"
        )
    overlaps = found.facts(is_adjusted=False)["overlaps"]
    pairs = [tuple(map(int, pair["strips"])) for pair in overlaps if pair["n_blocks"] >= _LEAST_BLOCKS]
    for when, cloud in (("before", judged), ("after", after)) if pairs else ():
        local = cloud.xyz - cloud.xyz.min(axis=0)
        largest = max(abs(above_triangles_m(local, strip, first, second)) for first, second in pairs)
        yield Row(f"{name}: largest median of points above triangles of another strip, {when}", largest, "m")
    is_named = "--adjust-strips" in found.sentence(is_adjusted=False)
    yield Row(f"{name}: an error is named", float(is_named), "1")
    yield Row(f"{name}: CPU time of {len(used):,} points", seconds, "s")


if __name__ == "__main__":
    main("Strip adjustment", measure, ("numpy", "scipy"))
