"""Change between two point clouds: distances along the normals, their map as change of height, and volumes over outlines.

The distances come from `survey.scoring.differencing.m3c2`. On ground up to 60 degrees steep they become changes of height, by
the cosine of the slope, on cells of the core points' spacing. Outlines and unchanged ground are compared there as rasters are
(`survey.scoring.differencing.difference.change`): the unchanged ground gives the level, the registration error where none is
stated, and the correlated errors of the volumes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    IntArray,
    check_types,
    printable,
    write_json,
)
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.io.point_files import write_point_table
from survey.io.point_table import PLACE, PointTable
from survey.scoring.accuracy import NMAD_FACTOR, ErrorStatistics
from survey.scoring.differencing.change_files import change_facts, write_change
from survey.scoring.differencing.difference import change
from survey.scoring.differencing.m3c2 import LEAST_POINTS, CloudDistances, m3c2
from survey.scoring.differencing.volume_change import (
    Change,
    ComparedGround,
    Outlines,
    datum_notes,
    scale_notes,
)

METHOD = "m3c2"
"""Name of the method among those of a change."""
POINT_COLUMNS = (
    *PLACE, "distance_m", "std_m", "sampling_std_m", "lod_m", "significant", "n_later", "n_earlier",
    "normal_east", "normal_north", "normal_up", "normal_scale_m",
)  # fmt: skip
"""Columns of the table of core points."""
# Cosine of the slope beyond which a distance is not counted as a change of height, and below which normals may flip.
_STEEPEST, _UPRIGHT = 0.5, 0.1
# Cells within an outline may differ from its area by this share without a note.
_MOST_OFF = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class CloudChange(DataObject):
    """Change between two point clouds.

    Parameters
    ----------
    distances : CloudDistances
        At the core points, levelled.
    change : Change, optional
        Map of the change of height and volumes over outlines; None where all core points are steeper than 60°.
    offset_m : float
        Median difference in height of the unchanged ground, which was subtracted [m].
    is_stated : bool
        Whether the registration error was stated; else it is of the unchanged ground.
    notes : tuple of str
        Assumptions behind the figures.
    """

    distances: CloudDistances
    change: Change | None
    offset_m: float
    is_stated: bool
    notes: tuple[str, ...]

    def facts(self, *density_kg_m3: float) -> dict[str, Any]:
        """Return everything but points and rasters, as JSON has it.

        Parameters
        ----------
        *density_kg_m3 : float
            Density of the gained or lost material and its standard deviation [kg/m³].

        Returns
        -------
        dict
            Under ``m3c2`` of the distances, and beside it as for a change of rasters.
        """
        found = self.distances
        statistics = ErrorStatistics.of(found.distance_m)
        of_map = {"notes": []} if self.change is None else change_facts(self.change, *density_kg_m3)
        mine = {
            "n": len(found.distance_m),
            "n_without": found.n_without,
            "median_m": statistics.median_m,
            "mean_m": statistics.bias_m,
            "nmad_m": statistics.nmad_m,
            "p95_m": statistics.p95_m,
            "worst_m": statistics.worst_m,
            "significant_share": float(np.mean(found.significant != 0)),
            "median_lod_m": float(np.median(found.lod_m)),
            "p95_lod_m": float(np.quantile(found.lod_m, 0.95)),
            "median_sampling_std_m": float(np.median(found.sampling_std_m)),
            "registration_m": found.registration_m,
            "registration_from": "stated" if self.is_stated else "unchanged ground",
            "offset_m": self.offset_m,
            "scales": found.scales._asdict(),
        }
        return {METHOD: mine, **of_map, "notes": [*self.notes, *of_map["notes"]]}

    def write(
        self, folder: Path, *density_kg_m3: float, outlines: Mapping[str, Polygon | MultiPolygon]
    ) -> None:
        """Write the core points (``change_points.laz`` and ``.csv``), ``change.json``, and the files of a change of rasters.

        Parameters
        ----------
        folder : pathlib.Path
            Where to.
        *density_kg_m3 : float
            As `facts` takes them.
        outlines : mapping of str to polygon
            The outlines by name.
        """
        table = PointTable(self._columns(), self.distances.crs, self.distances.vertical_datum)
        for ending in ("laz", "csv"):
            write_point_table(folder / f"change_points.{ending}", table)
        if self.change is not None:
            write_change(folder, self.change, *density_kg_m3, outlines=outlines)
        write_json(folder / "change.json", self.facts(*density_kg_m3))

    def _columns(self) -> dict[str, FloatArray]:
        found = self.distances
        of_distance = (found.distance_m, found.std_m, found.sampling_std_m, found.lod_m, found.significant)
        columns = (*found.xyz.T, *of_distance, found.n_later, found.n_earlier, *found.normals.T)
        values = (np.asarray(column, dtype=np.float64) for column in (*columns, found.normal_scale_m))
        return dict(zip(POINT_COLUMNS, values, strict=True))


@check_types
def change_of_clouds(
    later: SurfacePoints,
    earlier: SurfacePoints,
    outlines: Outlines | None = None,
    *,
    stable: Polygon | MultiPolygon | None = None,
    level: bool = True,
    registration_m: float | None = None,
    normals_m: tuple[float, ...] = (),
    cylinder_m: float | None = None,
    depth_m: float | None = None,
    spacing_m: float | None = None,
) -> CloudChange:
    """Compute the change between two point clouds by M3C2, with its level of detection.

    Parameters
    ----------
    later, earlier : SurfacePoints
        In one CRS and above one datum.
    outlines : mapping of str to polygon, optional
        Ground that may have changed, by name, in the clouds' CRS [m].
    stable : polygon, optional
        Ground that did not change; by default all outside the outlines, and none without them.
    level : bool
        Subtract the median difference in height of the unchanged ground, where there is some.
    registration_m : float, optional
        Error of the registration of the clouds, 1 σ [m]; by default that of the unchanged ground: what its distances scatter about 0
        beyond their sampling errors.
    normals_m, cylinder_m, depth_m, spacing_m
        As `survey.scoring.differencing.m3c2.m3c2` takes them.

    Returns
    -------
    CloudChange
        Distances, map and volumes.

    Raises
    ------
    InputError
        Neither a registration error nor unchanged ground, clouds that do not overlap, or what `change` refuses.
    """
    outlines = {} if outlines is None else outlines
    has_ground = bool(outlines) or stable is not None
    if registration_m is None and not has_ground:
        raise InputError(
            "the registration error of the clouds is not known; state it with --registration (1 σ [m]; 0 for clouds of one scan position), "
            "or name ground that did not change with --stable."
        )
    is_stated = registration_m is not None
    lengths = {"cylinder_m": cylinder_m, "depth_m": depth_m, "spacing_m": spacing_m}
    found = m3c2(later, earlier, registration_m=registration_m or 0.0, normals_m=normals_m, **lengths)
    cells = _Cells.of(found)
    compared, offset_m = None, 0.0
    if has_ground:
        compared = _compared(found, cells, outlines, stable, level=level)
        offset_m = compared.offset_m
        if registration_m is None:
            registration_m = _registration_m(found.registered(offset_m, 0.0), outlines, stable)
        found = found.registered(offset_m, registration_m)
    mapped = None if cells is None else cells.mapped(found, compared)
    datums = datum_notes(later.vertical_datum, earlier.vertical_datum) if compared is None else ()
    edges = () if cells is None else _edge_notes(cells.grid, outlines)
    return CloudChange(found, mapped, offset_m, is_stated, (*datums, *_notes(found), *edges))


def _compared(
    found: CloudDistances,
    cells: "_Cells | None",
    outlines: Outlines,
    stable: Polygon | MultiPolygon | None,
    *,
    level: bool,
) -> Change:
    """Compare heights with those that the distances add to them, by the unchanged ground."""
    if cells is None:
        raise InputError(
            "all core points lie on ground steeper than 60°, where heights are not compared; state the error with --registration, and "
            "leave --outline and --stable out."
        )
    old = cells.mean(found.xyz[:, 2])
    new = old + cells.mean(found.distance_m / found.normals[:, 2])
    later, earlier = (Dem.on(cells.grid, heights, found.vertical_datum) for heights in (new, old))
    return change(later, earlier, outlines, stable=stable, level=level)


def _registration_m(
    found: CloudDistances, outlines: Outlines, stable: Polygon | MultiPolygon | None
) -> float:
    """Return the registration error (1 sigma) [m] that the distances of unchanged ground show beyond their sampling errors."""
    x, y = found.xyz[:, :2].T
    unchanged = np.ones(len(x), dtype=bool) if stable is None else shapely.contains_xy(stable, x, y)
    for shape in outlines.values():
        unchanged &= ~shapely.contains_xy(shape, x, y)
    spread_m = NMAD_FACTOR * np.median(np.abs(found.distance_m[unchanged]))
    beyond = spread_m**2 - np.median(found.sampling_std_m[unchanged] ** 2)
    return float(np.sqrt(max(beyond, 0.0)))


@dataclass(frozen=True)
class _Cells:
    """Cells of a grid, the core points (N,) bool that are flat enough to be mapped, and the cell (N,) of each."""

    grid: Grid
    flat: BoolArray
    cell: IntArray

    @classmethod
    def of(cls, found: CloudDistances) -> "_Cells | None":
        """Return the cells about core points; None where all are too steep."""
        flat = found.normals[:, 2] >= _STEEPEST
        if not flat.any():
            return None
        step_m = found.scales.spacing_m
        place = np.floor(found.xyz[:, :2] / step_m).astype(np.int64)
        west, south = (place.min(axis=0) + 0.5) * step_m
        columns, rows = np.maximum(np.ptp(place, axis=0), 1)
        bounds = float(west), float(south), float(west + columns * step_m), float(south + rows * step_m)
        grid = Grid(bounds, step_m, found.crs)
        column, row = (place - place.min(axis=0)).T
        return cls(grid, flat, (grid.shape[0] - 1 - row) * grid.shape[1] + column)

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the means of the core points' values (N,) in each cell (H, W), NaN where there are none."""
        n_cells, cell = int(np.prod(self.grid.shape)), self.cell[self.flat]
        n = np.bincount(cell, minlength=n_cells)
        total = np.bincount(cell, values[self.flat], n_cells)
        return np.where(n > 0, total / np.maximum(n, 1), np.nan).reshape(self.grid.shape)

    def mapped(self, found: CloudDistances, compared: Change | None) -> Change:
        """Return the map of the change of height, with volumes where they were computed.

        Core points of one cell share points, so that their standard deviations are averaged.
        """
        up = found.normals[:, 2]
        heights, std_m, lod_m = (self.mean(v / up) for v in (found.distance_m, found.std_m, found.lod_m))
        significant = np.where(np.abs(heights) > lod_m, np.sign(np.nan_to_num(heights)), 0.0).astype(np.int8)
        difference = Dem.on(self.grid, heights, found.vertical_datum)
        if compared is None:
            return Change(difference, std_m, significant, (), METHOD, notes=scale_notes(difference))
        return replace(compared, difference=difference, std_m=std_m, significant=significant, method=METHOD)


def _notes(found: CloudDistances) -> tuple[str, ...]:
    """Return notes on core points without a distance, on steep ones, and on a registration error of 0."""
    n, up = len(found.distance_m), found.normals[:, 2]
    n_steep, n_upright = int((up < _STEEPEST).sum()), int((up < _UPRIGHT).sum())
    notes = []
    if found.n_without:
        notes.append(
            f"{found.n_without:,} of {n + found.n_without:,} core points have no distance, because a cloud has less than {LEAST_POINTS} "
            "points in the cylinder there: the clouds end, or --cylinder or --depth is too small"
        )
    if n_steep:
        notes.append(
            f"{n_steep:,} core points are steeper than 60°: they stand in the table of points, and not in the map of heights"
        )
    if n_upright:
        notes.append(
            f"{n_upright:,} core points are steeper than 84°: where the ground overhangs, the sign of their distances is reversed"
        )
    if found.registration_m == 0.0:
        notes.append("no registration error is in the levels of detection")
    notes.append(
        "the levels of detection take the errors of the points in a cylinder as independent beside the registration error"
    )
    return tuple(notes)


def _edge_notes(grid: Grid, outlines: Outlines) -> tuple[str, ...]:
    """Return a note on each outline that the cells cover with another area: its volume is as far off where change ends inside."""
    if not outlines:
        return ()
    inside = ComparedGround.of(grid, outlines, None).inside
    shares = {
        name: float(cells.sum()) * grid.step_m**2 / shape.area
        for (name, shape), cells in zip(outlines.items(), inside, strict=True)
    }
    return tuple(
        f"the cells of the map within {printable(name)} have {share:.1%} of its area, and its volume may be off by the difference: take "
        "smaller cells (--grid)"
        for name, share in shares.items()
        if share > 0.0 and abs(share - 1.0) > _MOST_OFF
    )
