"""Change on three public sites, against xdem with the same steps: ``python -m benchmarks.change_pairs``.

Mount St. Helens 2000 to 2004 (10 m and 2 m, the uplift in the crater), gullies of Fort Bragg 2004 to 2016 (lidar of 1 m, a
square of them), and the 47 glaciers about Exploradores: one real ASTER survey with its voids, and the same displaced,
tilted, thinned by elevation and with errors that are correlated over 300 m, so that the true change is known. Both are
compared with the same steps, shift and median; then all terms of firnline with xdem's shift, plane and median. Voids of xdem's
glaciers are filled by its local hypsometric means. Mass is volume times one density, and so is as far apart.
"""

import contextlib
import io
import os
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from affine import Affine

from benchmarks.change_worlds import exponential_field
from benchmarks.report import Row, cpu_seconds, main
from benchmarks.xdem_judge import aligned_difference, filled_mean
from survey.core.arrays import BoolArray, FloatArray
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.scoring.accuracy import NMAD_FACTOR
from survey.scoring.differencing.change_files import read_outlines
from survey.scoring.differencing.coregistration import align
from survey.scoring.differencing.difference import change
from survey.scoring.differencing.volume_change import Change, Outlines

DATA = Path(os.environ.get("FIRNLINE_DATA", "data"))
_UPLIFT = shapely.box(562450.0, 5115750.0, 562950.0, 5116350.0)
_GULLIES = shapely.box(597295.0, 150680.0, 597455.0, 150840.0)
# Where and how the second survey of Exploradores lies off the first.
_SHIFT_M, _TILT_M_PER_KM = (21.0, -13.0, 4.0), (0.4, -0.25)
_ERRORS = ((0.8, 0.0), (0.8, 300.0))


class _Pair(NamedTuple):
    """Two surveys and outlines; the true mean change of each outline where it is known [m]."""

    name: str
    later: Dem
    earlier: Dem
    outlines: Outlines
    true_m: dict[str, float] | None = None


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    for pair in (_crater(), _gullies(), _glaciers(seed=0)):
        yield from _compared(pair)
    if not quick:
        yield from _coverage([_glaciers(seed) for seed in range(1, 9)])


def _crater() -> _Pair:
    folder = DATA / "dem_volcano_msh_crater_series"
    files = (folder / "msh_20041013_2m.tif", folder / "msh_20000925_10m.tif")
    later, earlier = (Dem.read(file, vertical_datum="NAVD88 height") for file in files)
    return _Pair("Mount St. Helens", later.block_mean(10.0), earlier, {"uplift": _UPLIFT})


def _gullies() -> _Pair:
    folder = DATA / "dem_gully_fortbragg_3epochs"
    later, earlier = (
        Dem.read(folder / f"elevation_{year}_1m.tif", vertical_datum="NAVD88 height") for year in (2016, 2004)
    )
    return _Pair("Fort Bragg", later, earlier, {"gullies": _GULLIES})


def _glaciers(seed: int) -> _Pair:
    """Return the survey of Exploradores as the earlier one, and a later one that is displaced and whose glaciers sank."""
    folder = DATA / "dem_exploradores_aster"
    earlier = Dem.read(folder / "AST_L1A_00303182012144228_Z.tif", vertical_datum="EGM96 height")
    outlines = read_outlines(folder / "17_rgi60_glacier_outlines.gpkg", earlier.crs)
    rng, xy = stream(seed, "glaciers about Exploradores"), earlier.xy
    ground = earlier.at(xy - _SHIFT_M[:2]).reshape(earlier.shape)
    x, y = (xy[:, k].reshape(earlier.shape) - xy[:, k].mean() for k in (0, 1))
    errors = _SHIFT_M[2] + 0.001 * (_TILT_M_PER_KM[0] * x + _TILT_M_PER_KM[1] * y)
    for size_m, length_m in _ERRORS:
        white = rng.standard_normal(earlier.shape)
        n = max(earlier.shape)
        cut = np.s_[: earlier.shape[0], : earlier.shape[1]]
        errors += size_m * (exponential_field(rng, n, length_m / earlier.step_m)[cut] if length_m else white)
    inside = {name: _cells(earlier, shape) for name, shape in outlines.items()}
    on_ice = np.logical_or.reduce([*inside.values()])
    thinned = np.where(on_ice, np.interp(earlier.elevation, [200.0, 2500.0], [-12.0, 1.0]), 0.0)
    true_m = {name: float(np.nanmean(thinned[cells])) for name, cells in inside.items() if cells.any()}
    later = Dem(ground + thinned + errors, earlier.transform, earlier.crs, earlier.vertical_datum)
    return _Pair("Exploradores", later, earlier, outlines, true_m)


def _cells(dem: Dem, shape: shapely.Geometry) -> BoolArray:
    cells: BoolArray = shapely.contains_xy(shape, *dem.xy.T).reshape(dem.shape)
    return cells


def _compared(pair: _Pair) -> Iterator[Row]:
    """Yield how far firnline and xdem are apart, and whether the standard deviation covers that."""
    found, seconds = cpu_seconds(lambda: change(pair.later, pair.earlier, pair.outlines, align=True))
    yield Row(f"{pair.name}: outlines of {len(pair.outlines)} that both map by half", len(found.volumes), "1")
    yield Row.of(f"{pair.name}: CPU time of the change", seconds, "s", "<=", 60.0)
    assert found.alignment is not None
    for name, std in found.alignment.std.items():
        unit = {"curvature_bias_m2": "m²"}.get(name, "m/km" if "tilt" in name else "m")
        words = name.removesuffix("_m2").removesuffix("_m_per_km").removesuffix("_m").replace("_", " ")
        yield Row(f"{pair.name}: {words} ± {std:.3f}", getattr(found.alignment, name), unit)
    stable = _stable(found, pair.outlines)
    rest = found.difference.elevation[stable]
    yield Row.of(f"{pair.name}: median of unchanged ground", abs(float(np.median(rest))), "m", "<=", 0.02)
    shift = align(pair.earlier, pair.later, stable, only_shift=True).alignment
    place = pair.earlier.transform @ Affine.translation(
        shift.east_m / pair.earlier.step_m, -shift.north_m / pair.earlier.step_m
    )
    moved = replace(pair.earlier, transform=place)
    yield from _apart(
        f"{pair.name}, shift and median",
        pair,
        change(pair.later, moved, pair.outlines),
        _theirs(pair, stable),
    )
    theirs = _theirs(pair, stable, has_plane=True)
    name = f"{pair.name}, all terms; xdem: shift, plane, median"
    yield Row(f"{name}: NMAD of unchanged ground", found.alignment.nmad_after_m, "m")
    yield Row(f"{name}: NMAD by xdem", NMAD_FACTOR * _mad(theirs[stable]), "m")
    yield from _apart(name, pair, found, theirs)
    if pair.true_m is not None:
        yield from _true(pair, found, theirs)


def _apart(name: str, pair: _Pair, found: Change, theirs: FloatArray) -> Iterator[Row]:
    means_m = _means_of_xdem(pair, found, theirs)
    off = np.array([one.mean_m for one in found.volumes]) - means_m
    sigma = np.array([one.std_m3 / one.area_m2 for one in found.volumes])
    if len(off) == 1:
        yield Row(f"{name}: mean change ± {sigma[0]:.3f}", found.volumes[0].mean_m, "m")
        yield Row(f"{name}: mean change by xdem", float(means_m[0]), "m")
    yield Row.of(f"{name}: mean change apart, median", float(np.median(np.abs(off))), "m", "<=", 0.02)
    yield Row.of(f"{name}: mean change apart, worst", float(np.abs(off).max()), "m", "<=", 0.02)
    share = 100.0 * np.abs(off / means_m)
    yield Row.of(f"{name}: volume and mass apart, median", float(np.median(share)), "%", "<=", 2.0)
    yield Row.of(f"{name}: volume and mass apart, worst", float(share.max()), "%", "<=", 2.0)
    yield Row.of(f"{name}: apart in σ, worst", float(np.abs(off / sigma).max()), "1", "<=", 1.96)


def _means_of_xdem(pair: _Pair, found: Change, theirs: FloatArray) -> FloatArray:
    """Return xdem's mean change (N,) of the outlines that were integrated over [m]."""
    heights = pair.earlier.at(found.difference.xy).reshape(found.difference.shape)
    cells = (_cells(found.difference, pair.outlines[one.name]) for one in found.volumes)
    return np.array([filled_mean(theirs, heights, inside) for inside in cells])


def _true(pair: _Pair, found: Change, theirs: FloatArray) -> Iterator[Row]:
    """Yield the errors of both against the true change."""
    assert pair.true_m is not None
    true_m = np.array([pair.true_m[one.name] for one in found.volumes])
    ours = np.array([one.mean_m for one in found.volumes])
    for name, mean_m in (("firnline", ours), ("xdem", _means_of_xdem(pair, found, theirs))):
        off = mean_m - true_m
        yield Row(
            f"{pair.name}: error of the mean change by {name}, RMS", float(np.sqrt(np.mean(off**2))), "m"
        )
        yield Row(f"{pair.name}: error of the mean change by {name}, worst", float(np.abs(off).max()), "m")


def _coverage(pairs: list[_Pair]) -> Iterator[Row]:
    """Yield how often the 95 % intervals of glaciers hold, over pairs of other seeds."""
    holds, ratio = [], []
    for pair in pairs:
        assert pair.true_m is not None
        for one in change(pair.later, pair.earlier, pair.outlines, align=True).volumes:
            off_m = one.mean_m - pair.true_m[one.name]
            holds.append(abs(off_m) * one.area_m2 <= one.half_width_95_m3)
            ratio.append(off_m * one.area_m2 / one.std_m3)
    name = f"Exploradores: {len(holds)} changes of glaciers, {len(pairs)} pairs"
    yield Row.of(f"{name}: 95 % interval holds", 100.0 * float(np.mean(holds)), "%", ">=", 90.0)
    yield Row(f"{name}: error over σ, RMS", float(np.sqrt(np.mean(np.square(ratio)))), "1")
    yield Row(f"{name}: error over σ, worst", float(np.abs(ratio).max()), "1")


def _stable(found: Change, outlines: Outlines) -> BoolArray:
    inside = np.logical_or.reduce([_cells(found.difference, shape) for shape in outlines.values()])
    stable: BoolArray = ~inside & np.isfinite(found.difference.elevation)
    return stable


def _theirs(pair: _Pair, stable: BoolArray, *, has_plane: bool = False) -> FloatArray:
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        return aligned_difference(pair.later, pair.earlier, stable, has_plane=has_plane)


def _mad(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(np.abs(known - np.median(known))))


if __name__ == "__main__":
    main("Change on public sites", measure, ("numpy", "scipy", "rasterio", "xdem", "geoutils"))
