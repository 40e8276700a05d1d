"""Comparison and adjustment of the overlapping strips of a point cloud in memory.

Points name their strip, such as the flight line of LAS (point source). Cells that two strips have seen give differences of
their mean heights, brought to one place by the slope. Blocks of cells whose difference stands apart from the others, such as
those of plants that one strip alone has seen, are left out. `compare_strips` estimates the errors of every strip from the rest
by the least squares of maps in tiles (`survey.reconstruction.tiled.strips`): an offset, tilts where the overlaps show them, and
a horizontal shift on slopes. Heights on ground as steep as the overlaps are stated, as uniform slopes do not separate an offset from a
shift. Differences do not show the level of all strips together: heights count from the mean of the strips that overlap one another.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import ndtri
from threadpoolctl import threadpool_limits

from survey.core import BoolArray, DataObject, FloatArray, InputError, IntArray
from survey.data import Dem, SurfacePoints
from survey.data.ground_filter import spacing_m
from survey.reconstruction.terrain_map import ADJUSTMENT, STRIP_NAMES, Reconstruction
from survey.reconstruction.tiled.cells import CELL
from survey.reconstruction.tiled.layout import CellWindow
from survey.reconstruction.tiled.strips import (
    N_TERMS,
    Sizes,
    StripErrors,
    StripPairs,
    StripPlaces,
    solve_strips,
)
from survey.reconstruction.tiled.summaries import (
    OVERLAP,
    USUAL_M2,
    detrended_variance,
    overlaps,
    shrunk_variance,
    usual_variance,
)

# Side of a cell in mean distances of points, the least one [m], and the most cells of the raster of slopes.
_CELL_SPACINGS, _LEAST_CELL_M, _MOST_CELLS = 1.5, 1.0, 20_000_000
# Sizes of the strips' errors that are expected: those of maps in tiles.
_EXPECTED = Sizes(offset_m=0.2, tilt_m=0.1)
# Blocks farther from the others than so many standard deviations are left out, by so many rounds, where there are some.
_OUTLIER_SIGMAS, _ROUNDS, _LEAST_BLOCKS = 4.0, 4, 8
_MAD_TO_SIGMA = 1.4826
# Share of surveys without errors of strips in which a difference is named.
_FALSE_ALARM = 0.05
_LARGEST_NUMBER, _MOST_STRIPS = 2**31, 1000


@dataclass(frozen=True, eq=False, repr=False)
class StripAdjustment(DataObject):
    """Errors of the strips of a point cloud by their overlaps.

    Parameters
    ----------
    strip : (N,) ndarray of int
        Number of each point's strip, which may be 0.
    errors : StripErrors, optional
        Of the strips that overlap another one, by number + 1. None where no strip does.
    blocks : (B,) ndarray
        Blocks of cells that two strips have seen, without outliers.
    n_outliers : int
        Blocks that were left out.
    alone : tuple of int
        Strips without overlap.
    n_groups : int
        Groups of strips that overlap one another.
    """

    strip: IntArray
    errors: StripErrors | None
    blocks: npt.NDArray[np.void]
    n_outliers: int
    alone: tuple[int, ...]
    n_groups: int

    def adjusted(self, points: SurfacePoints) -> SurfacePoints:
        """Return points without the errors of their strips; those of strips without overlap stay.

        Parameters
        ----------
        points : SurfacePoints
            Those that were compared.

        Returns
        -------
        SurfacePoints
            At shifted places.
        """
        errors, moved = self._errors(), ~np.isin(self.strip, self.alone)
        keys = (self.strip[moved] + 1).astype(np.uint32)
        xyz = points.xyz.copy()
        xyz[moved, :2] -= errors.errors[errors.places.numbers(keys), 3:]
        xyz[moved, 2] -= errors.at(keys, xyz[moved, :2], np.zeros((len(keys), 2)))
        return replace(points, xyz=xyz)

    def recorded(self, result: Reconstruction, points: SurfacePoints, *, is_adjusted: bool) -> Reconstruction:
        """Return a map with the comparison in its record and, of adjusted points, what is left of the strips' errors in its σ.

        Parameters
        ----------
        result : Reconstruction
            The map.
        points : SurfacePoints
            Those that were mapped.
        is_adjusted : bool
            Whether they are adjusted.

        Returns
        -------
        Reconstruction
            Its standard deviation holds the errors of the adjustment at the strip of the nearest point.
        """
        facts = {**result.diagnostics, **self.facts(is_adjusted=is_adjusted)}
        if not is_adjusted:
            return replace(result, diagnostics=facts)
        std = result.std
        _, nearest = cKDTree(points.xy).query(std.xy)
        variance = self.variance_m2(np.asarray(nearest), std.xy, _slopes(result.mean))
        raised = Dem.on(
            std.grid(), np.sqrt(std.elevation**2 + variance.reshape(std.shape)), std.vertical_datum
        )
        return replace(result, std=raised, diagnostics=facts)

    def facts(self, *, is_adjusted: bool) -> dict[str, Any]:
        """Return strips, overlaps and sentence for the record.

        Parameters
        ----------
        is_adjusted : bool
            Whether the points are adjusted.

        Returns
        -------
        dict
            ``strips`` and ``overlaps``, where there are any, and ``strip_adjustment``.
        """
        summary: dict[str, Any] = {
            "sentence": self.sentence(is_adjusted=is_adjusted),
            "is_adjusted": is_adjusted,
            "without_overlap": [str(number) for number in self.alone],
        }
        if self.errors is None:
            return {ADJUSTMENT: summary}
        before_m, after_m = self.rms_m()
        summary |= {
            "rms_before_m": before_m, "rms_after_m": after_m, "n_blocks": len(self.blocks),
            "n_outliers": self.n_outliers, "n_groups": self.n_groups, "rest_m": self.errors.sizes.rest_m(),
        }  # fmt: skip
        height_m, sigma_m = self.heights_m()
        pairs = _pairs(self.errors, self.blocks)
        strips = {
            name: {
                "height_m": float(height),
                "height_m_sigma": float(sigma),
                **{term: value for term, value in own.items() if not term.startswith("offset")},
                "n_blocks": sum(pair["n_blocks"] for pair in pairs if name in pair["strips"]),
            }
            for name, height, sigma, own in zip(
                (str(int(key) - 1) for key in self.errors.places.keys),
                height_m,
                sigma_m,
                self.errors.facts().values(),
                strict=True,
            )
        }
        return {"strips": strips, "overlaps": pairs, ADJUSTMENT: summary}

    def heights_m(self) -> tuple[FloatArray, FloatArray]:
        """Return how far the strips lie above their mean, at the middle of each and on ground as steep as their overlaps.

        Returns
        -------
        heights, sigmas : (S,) ndarray
            Of the strips that overlap another one, with the standard deviations [m].
        """
        errors = self._errors()
        rows = _height_rows(errors.places, self.blocks)
        return rows @ errors.errors.ravel(), np.sqrt(np.sum((rows @ errors.covariance) * rows, axis=1))

    def rms_m(self) -> tuple[float, float]:
        """Return the root mean square difference of strips over blocks of cells.

        Returns
        -------
        before, after : float
            As measured, and without the errors of the strips [m].
        """
        weight = self.blocks["n"]
        measured = self.blocks["d"] / weight
        rest = measured - _expected(self._errors(), self.blocks)
        before, after = (float(np.sqrt(np.average(each**2, weights=weight))) for each in (measured, rest))
        return before, after

    def sentence(self, *, is_adjusted: bool) -> str:
        """State what the overlaps show in one sentence.

        Parameters
        ----------
        is_adjusted : bool
            Whether the points are adjusted.

        Returns
        -------
        str
            With the largest difference of two strips and, of adjusted points, the range of the heights.
        """
        alone = ", ".join(map(str, self.alone[:5])) + (" …" if len(self.alone) > 5 else "")
        left = f"; left as they are, without overlap: {alone}" if self.alone else ""
        if self.errors is None:
            return f"{len(self.alone)} strips, and none overlaps another one, so that their heights are not compared"
        before_m, after_m = self.rms_m()
        seen = f"{len(self.errors.places.keys)} strips, {len(self.blocks)} blocks of overlap"
        if is_adjusted:
            height_m, sigma_m = self.heights_m()
            groups = f" in each of {self.n_groups} groups" if self.n_groups > 1 else ""
            return (
                f"{seen}, adjusted by {-height_m.max():+.3f} to {-height_m.min():+.3f} m (σ up to {sigma_m.max():.3f} m) about "
                f"their mean{groups}; overlaps differ by {after_m:.3f} m (RMS), {before_m:.3f} m before{left}"
            )
        pairs = _pairs(self.errors, self.blocks)
        most = max(pairs, key=lambda pair: abs(pair["height_m"]) / pair["height_m_sigma"])
        apart_m, sigma_m = most["height_m"], most["height_m_sigma"]
        above, below = most["strips"] if apart_m > 0.0 else most["strips"][::-1]
        is_large = abs(apart_m) > -ndtri(0.5 * _FALSE_ALARM / len(pairs)) * sigma_m
        advice = "; σ of the map does not contain that, and --adjust-strips removes it" if is_large else ""
        return (
            f"{seen}, which differ by {before_m:.3f} m (RMS): {above} lies {abs(apart_m):.3f} ± {sigma_m:.3f} m above {below}"
            f"{advice}{left}"
        )

    def variance_m2(self, nearest: IntArray, xy: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the variance of the adjustment at places, about the mean of the strips.

        Parameters
        ----------
        nearest : (N,) ndarray of int
            The points nearest to the places, by whose strips they are adjusted.
        xy : (N, 2) ndarray
            Easting and northing [m].
        slope : (N, 2) ndarray
            Slopes eastwards and northwards [m/m].

        Returns
        -------
        (N,) ndarray
            Variance [m²]; 0 for strips without overlap, whose errors are not known.
        """
        errors, strip = self._errors(), self.strip[nearest]
        moved = np.flatnonzero(~np.isin(strip, self.alone))
        number = errors.places.numbers((strip[moved] + 1).astype(np.uint32))
        rows = errors.places.design(number, xy[moved], slope[moved])
        n = len(errors.errors)
        own = errors.covariance.reshape(n, N_TERMS, n, N_TERMS)[np.arange(n), :, np.arange(n), :]
        variance = np.zeros(len(xy))
        variance[moved] = np.einsum("na,nab,nb->n", rows, own[number], rows) + errors.sizes.rest_m() ** 2
        return variance

    def _errors(self) -> StripErrors:
        if self.errors is None:
            raise InputError(
                f"no strip overlaps another one ({len(self.alone)} strips), so that nothing shows their errors; leave --adjust-strips out."
            )
        return self.errors


@threadpool_limits.wrap(limits=1, user_api="blas")
def compare_strips(points: SurfacePoints) -> StripAdjustment | None:
    """Estimate the errors of the strips that points name by their overlaps.

    Parameters
    ----------
    points : SurfacePoints
        Of the ground, with a value ``strip`` or ``point_source_id``: numbers from 0.

    Returns
    -------
    StripAdjustment
        None where the points do not name 2 to 1,000 strips.
    """
    strip = _strips_of(points)
    if strip is None:
        return None
    keys = (strip + 1).astype(np.uint32)
    cells, blocks, cell_m = _overlaps(points.xyz, keys)
    is_seen = np.isin(np.unique(keys), [blocks["first"], blocks["second"]])
    alone = tuple(int(key) - 1 for key in np.unique(keys)[~is_seen])
    if not is_seen.any():
        return StripAdjustment(strip, None, blocks, 0, alone, 0)
    cells = cells[~np.isin(cells["strip"], np.array(alone) + 1)]
    x, y = ((cells[a] + 0.5) * cell_m for a in ("column", "row"))
    places = StripPlaces.of([np.column_stack([cells["strip"], np.ones(len(x)), x, y, x * x, y * y])])
    errors, kept = _without_outliers(places, blocks)
    errors, n_groups = _about_mean(errors, blocks[kept])
    return StripAdjustment(strip, errors, blocks[kept], int((~kept).sum()), alone, n_groups)


def _strips_of(points: SurfacePoints) -> IntArray | None:
    """Return the numbers of the points' strips (N,); None where they name none, one alone, or what is no number of a strip."""
    named = next((points.values[name] for name in STRIP_NAMES if name in points.values), None)
    if named is None or not ((named == np.round(named)) & (named >= 0) & (named < _LARGEST_NUMBER)).all():
        return None
    return named.astype(np.int64) if 2 <= len(np.unique(named)) <= _MOST_STRIPS else None


def _overlaps(
    xyz: FloatArray, keys: npt.NDArray[np.uint32]
) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void], float]:
    """Return the cells of every strip, the blocks of cells that two of them have seen, and the side of a cell [m]."""
    extent_m2 = float(np.prod(np.ptp(xyz[:, :2], axis=0) + _LEAST_CELL_M))
    cell_m = max(_LEAST_CELL_M, _CELL_SPACINGS * spacing_m(xyz[:, :2]), (extent_m2 / _MOST_CELLS) ** 0.5)
    cells, window = _cells(xyz, keys, cell_m)
    variance = detrended_variance(cells, window)
    usual_m2 = usual_variance(variance, cells["n"])
    per_point = shrunk_variance(variance, cells["n"], usual_m2 if np.isfinite(usual_m2) else USUAL_M2)
    return cells, overlaps(cells, window, cell_m, per_point), cell_m


def _cells(
    xyz: FloatArray, keys: npt.NDArray[np.uint32], cell_m: float
) -> tuple[npt.NDArray[np.void], CellWindow]:
    """Return the statistics of each strip in each cell (`CELL`), by rows, columns and strips, and the window of the cells."""
    at = np.floor(xyz[:, :2] / cell_m).astype(np.int64)
    west, south = at.min(axis=0)
    columns, rows = at.max(axis=0) - (west, south) + 1
    names, strip = np.unique(keys, return_inverse=True)
    flat = ((at[:, 1] - south) * columns + at[:, 0] - west) * len(names) + strip.ravel()
    present, cell, n = np.unique(flat, return_inverse=True, return_counts=True)
    cells = np.zeros(len(present), CELL)
    place, number = np.divmod(present, len(names))
    cells["row"], cells["column"] = place // columns + south, place % columns + west
    cells["strip"], cells["n"] = names[number], n
    inside = xyz[:, :2] / cell_m - at
    for name, column in (("x", inside[:, 0]), ("y", inside[:, 1]), ("z", xyz[:, 2])):
        cells[name] = np.bincount(cell, column) / n
    squares = np.bincount(cell, (xyz[:, 2] - cells["z"][cell]) ** 2)
    cells["variance"] = squares / np.maximum(n - 1, 1)
    return cells, CellWindow(int(west), int(south), int(columns), int(rows))


def _without_outliers(places: StripPlaces, blocks: npt.NDArray[np.void]) -> tuple[StripErrors, BoolArray]:
    """Return the errors of strips, and which blocks they are estimated from.

    Tilts follow plants at one end of a strip, so that the first comparison is with the median of each pair of strips.
    """
    _, pair = np.unique(blocks[["first", "second"]], return_inverse=True)
    measured = blocks["d"] / blocks["n"]
    medians = np.array([np.median(measured[pair == k]) for k in range(pair.max() + 1)])
    now = _inliers(measured - medians[pair], pair)
    for _ in range(_ROUNDS):
        kept = now
        errors = solve_strips(places, blocks[kept], np.zeros(0, OVERLAP), _EXPECTED)
        sigma_m = np.sqrt(blocks["scatter"] / blocks["n"] + 2.0 * errors.sizes.rest_m() ** 2)
        now = _inliers((measured - _expected(errors, blocks)) / sigma_m, pair)
        if (now == kept).all():
            break
    return errors, kept


def _inliers(rest: FloatArray, pair: IntArray) -> BoolArray:
    """Return which residuals (N,) lie near the others; all where they are few, and all of a pair of strips with none."""
    away = np.abs(rest - np.median(rest))
    near = away <= _OUTLIER_SIGMAS * _MAD_TO_SIGMA * np.median(away)
    found: BoolArray = near | (np.bincount(pair, near)[pair] == 0) | (len(rest) < _LEAST_BLOCKS)
    return found


def _expected(errors: StripErrors, blocks: npt.NDArray[np.void]) -> FloatArray:
    """Return the mean difference of heights in each block (N,) that the errors of its two strips make [m]."""
    xy = np.column_stack([blocks["x"], blocks["y"]])
    slope = np.column_stack([blocks["e"], blocks["v"]]) / blocks["n"][:, None]
    made: FloatArray = errors.at(blocks["first"], xy, slope) - errors.at(blocks["second"], xy, slope)
    return made


def _about_mean(errors: StripErrors, blocks: npt.NDArray[np.void]) -> tuple[StripErrors, int]:
    """Return errors whose heights count from the mean of the strips that overlap one another, and the number of such groups."""
    n = len(errors.places.keys)
    ends = tuple(errors.places.numbers(blocks[name]) for name in ("first", "second"))
    n_groups, group = connected_components(
        coo_array((np.ones(len(blocks)), ends), shape=(n, n)), directed=False
    )
    together = (group[:, None] == group).astype(np.float64)
    change = np.eye(n * N_TERMS)
    change[::N_TERMS] -= together / together.sum(axis=1) @ _height_rows(errors.places, blocks)
    centred = (change @ errors.errors.ravel()).reshape(n, N_TERMS)
    return replace(errors, errors=centred, covariance=change @ errors.covariance @ change.T), int(n_groups)


def _height_rows(places: StripPlaces, blocks: npt.NDArray[np.void]) -> FloatArray:
    """Return the rows (S, 5 S) that make the errors of all strips the error of height of each, on ground as steep as its overlaps."""
    n = len(places.keys)
    sums = np.zeros((n, 3))
    for name in ("first", "second"):
        np.add.at(sums, places.numbers(blocks[name]), np.column_stack([blocks[k] for k in "nev"]))
    rows = np.zeros((n, n, N_TERMS))
    own = np.arange(n)
    rows[own, own] = places.design(own, places.middle, sums[:, 1:] / sums[:, :1])
    return rows.reshape(n, -1)


def _pairs(errors: StripErrors, blocks: npt.NDArray[np.void]) -> list[dict[str, Any]]:
    """Return how far each strip lies above another one at the middle of their overlap, on ground as steep as that, for the record."""
    found = []
    for first, second, n, x, y, east, north, *_ in StripPairs.of(blocks).table.tolist():
        height_m, sigma_m = errors.offset_between(int(first), int(second), np.array([x, y]), (east, north))
        names = [str(int(key) - 1) for key in (first, second)]
        found.append({"strips": names, "n_blocks": int(n), "height_m": height_m, "height_m_sigma": sigma_m})
    return found


def _slopes(mean: Dem) -> FloatArray:
    """Return the slopes eastwards and northwards at the nodes of a map (N, 2) [m/m]; 0 where a neighbour is missing."""
    if min(mean.shape) < 2:
        return np.zeros((mean.elevation.size, 2))
    south, east = np.gradient(mean.elevation, mean.step_m)
    slopes: FloatArray = np.nan_to_num(np.column_stack([east.ravel(), -south.ravel()]))
    return slopes
