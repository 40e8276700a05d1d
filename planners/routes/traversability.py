"""Traversability: ground within a rover's limits of slope, roughness and width, reachable from its starts.

`drivable` closes the cells of a DEM that are too steep or too rough, ground that is too narrow, and pieces that no start
reaches. It returns the free ground, and each piece that is left out with the reason. `slope_scale` finds over which scale
the slopes of a noisy product are read. `without_marked` cuts the marked cells of a raster out of an area as no-go zones;
`between_heights` cuts an area to a range of heights.
"""

import logging
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import rasterio.features
import shapely
from scipy.ndimage import convolve, gaussian_filter
from shapely import MultiPolygon, Polygon

from planners.capacity import require_cells
from planners.config import dem_in_grid_metres, in_grid_metres, settings_factor
from planners.prediction.assumptions import roughness_elsewhere
from planners.routes.rover import RoverLimits
from planners.routes.shortest_paths import FreeGround, shared_ground
from survey import Dem, InputError, Route, SurveyArea
from survey.core import BoolArray, FloatArray
from survey.reconstruction.prior import PRODUCTS, PriorErrors

logger = logging.getLogger(__name__)


def roughness(dem: Dem) -> FloatArray:
    """Return the standard deviation of heights about the plane through each 3 × 3 cells [m].

    The plane is the least-squares one; with nine heights and three parameters the sum of
    squares is divided by six. NaN at the border and beside nodata.

    >>> from affine import Affine
    >>> tilted = Dem(np.add.outer(np.arange(4.0), np.arange(4.0)), Affine(1, 0, 0, 0, -1, 0), "EPSG:32608")
    >>> bool(np.nanmax(roughness(tilted)) < 1e-9)
    True
    """
    z = dem.elevation - np.nanmean(dem.elevation)
    ones, step = np.ones((3, 3)), np.array([-1.0, 0.0, 1.0])
    mean = convolve(z, ones / 9.0, mode="constant", cval=np.nan)
    square = convolve(z * z, ones, mode="constant", cval=np.nan)
    east = convolve(z, np.tile(step, (3, 1)), mode="constant", cval=np.nan)
    north = convolve(z, np.tile(step[:, None], (1, 3)), mode="constant", cval=np.nan)
    # Over nine cells the columns and rows are orthogonal with squared length 6.
    residual = square - 9.0 * mean**2 - (east**2 + north**2) / 6.0
    sd: FloatArray = np.sqrt(np.maximum(residual, 0.0) / 6.0)
    return sd


class SlopeScale(NamedTuple):
    """Scale over which slopes are read, in cells (0 for those between cells), and how far errors tilt the ground there [deg].

    The tilt is the standard deviation along either axis.
    """

    n_cells: float
    tilt_deg: float

    def slope_deg(self, dem: Dem) -> FloatArray:
        """Return the slope of the least-squares plane about each cell, weighted by a Gaussian with this deviation [deg].

        At the border and beside unknown cells the plane is that of the known cells on one side.
        """
        if self.n_cells == 0.0:
            return dem.slope().elevation
        known = np.isfinite(dem.elevation)
        row, column = np.indices(dem.shape, dtype=float)
        basis = [known * values for values in (1.0 + 0.0 * row, row - row.mean(), column - column.mean())]
        z = np.where(known, dem.elevation - np.nanmean(dem.elevation), 0.0)
        normal, right = ([[self._mean(a * b) for b in other] for a in basis] for other in (basis, [z]))
        # A little is added where no cell nearby is known.
        matrices = np.moveaxis(np.array(normal), (0, 1), (-2, -1)) + 1e-9 * np.eye(3)
        plane = np.linalg.solve(matrices, np.moveaxis(np.array(right), (0, 1), (-2, -1)))[..., 0]
        slope_deg: FloatArray = np.degrees(np.arctan(np.hypot(plane[..., 1], plane[..., 2]) / dem.step_m))
        return slope_deg

    def _mean(self, values: FloatArray) -> FloatArray:
        return np.asarray(gaussian_filter(values, self.n_cells, mode="constant"))


# Scales that are tried, in cells; errors that tilt the ground by a fifth of the limit exceed it nowhere.
_SCALES = (0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
_SMALL_TILT = 0.2


def slope_scale(cell_m: float, limits: RoverLimits) -> SlopeScale:
    """Return the smallest scale at which the errors of the limits' product tilt the ground by a fifth of the limit at most.

    Where no scale up to eight cells is enough, it is eight cells. `cell_m`: width of a cell on the ground [m].

    >>> slope_scale(30.0, RoverLimits(max_pitch_deg=10.0, slope_product="aster-30")).n_cells
    1.5
    """
    if limits.slope_product is None or limits.max_slope_deg is None:
        return SlopeScale(0.0, 0.0)
    errors, most = PRODUCTS[limits.slope_product], _SMALL_TILT * np.tan(np.radians(limits.max_slope_deg))
    for n_cells in _SCALES:
        rise = _error_rise(errors, cell_m, n_cells)
        if rise <= most:
            break
    return SlopeScale(n_cells, float(np.degrees(np.arctan(rise))))


def slope_texts(dem: Dem, area: SurveyArea, limit_deg: float, product: str | None) -> list[str]:
    """Return in sentences over which scale slopes are read, how far errors tilt the ground there, and if the heights err more."""
    cell_m = dem.step_m / settings_factor(area)
    found = []
    if product is not None:
        n_cells, tilt_deg = slope_scale(cell_m, RoverLimits(max_pitch_deg=limit_deg, slope_product=product))
        over = f"by planes of ± {n_cells * cell_m:.0f} m about each cell" if n_cells else "between its cells"
        found = [
            f"slopes of the prior are read {over}, where the errors of {product} tilt the ground by {tilt_deg:.1f}° (1 σ)."
        ]
    bend_m, usual_m = _bends(dem, area, cell_m)
    stated_m = 0.0 if product is None else _error_bend_m(PRODUCTS[product], _BEND_CELLS * cell_m)
    if bend_m > np.hypot(usual_m, stated_m):
        remedy = "take another prior" if product else "name its class with --product, or take another"
        found.append(
            f"the prior's heights differ by {bend_m:.0f} m from straight lines of {2 * _BEND_CELLS * cell_m:.0f} m, where ground "
            f"as steep differs by {usual_m:.0f} m at most and {product or 'no product'} is stated to err by {stated_m:.0f} m: "
            f"what is too steep may be an error of the prior, as under clouds; {remedy}."
        )
    return found


_BEND_CELLS = 3


def _bends(dem: Dem, area: SurveyArea, cell_m: float) -> tuple[float, float]:
    """Return how far heights are from the chord over six cells, and how far on ground as steep elsewhere at most [m].

    Both are standard deviations; the first is robust, the second is two spreads above the mean.
    """
    near = dem.window(area.bounds)
    inside = area.contains(near.xy).reshape(near.shape)
    z, n = np.where(inside, near.elevation, np.nan), _BEND_CELLS
    bends = [z[2 * n :] - 2.0 * z[n:-n] + z[: -2 * n], z[:, 2 * n :] - 2.0 * z[:, n:-n] + z[:, : -2 * n]]
    known = np.concatenate([bend[np.isfinite(bend)] for bend in bends])
    if not len(known):
        return 0.0, 0.0
    rise = np.tan(
        np.radians(SlopeScale(_SCALES[-1], 0.0).slope_deg(near)[inside & np.isfinite(near.elevation)])
    )
    elsewhere = roughness_elsewhere(n * cell_m, float(np.median(rise)) * dem.step_m / cell_m)
    usual_m = float(np.exp(elsewhere.mean + 2.0 * np.sqrt(elsewhere.variance)))
    return 0.5 * 1.4826 * float(np.median(np.abs(known))), 0.5 * usual_m


def _error_bend_m(errors: PriorErrors, lag_m: float) -> float:
    """Return the standard deviation that errors of a product give to heights less the chord over two lags [m]."""
    near, far = np.exp(-np.array([1.0, 2.0]) * lag_m / errors.correlation_m)
    correlated_m2 = errors.correlated.median_m**2 * (6.0 - 8.0 * near + 2.0 * far)
    return 0.5 * float(np.sqrt(6.0 * errors.white.median_m**2 + correlated_m2))


def _error_rise(errors: PriorErrors, cell_m: float, n_cells: float) -> float:
    """Return the standard deviation of the rise that errors of cells have along one axis, over a scale in cells."""
    from scipy.signal import correlate  # loads two hundred modules

    offset, weight = _gaussian(max(n_cells, 0.2))
    weights = np.outer(weight, weight * offset)
    weights /= cell_m * np.sum(weights * offset)
    lag_m = cell_m * (np.arange(2 * len(offset) - 1) - len(offset) + 1.0)
    apart_m = np.hypot(lag_m[:, None], lag_m)
    correlated = errors.correlated.median_m**2 * np.exp(-apart_m / errors.correlation_m)
    covariance = correlated + np.where(apart_m == 0.0, errors.white.median_m**2, 0.0)
    return float(np.sqrt(np.sum(correlate(weights, weights) * covariance)))


def _gaussian(n_cells: float) -> tuple[FloatArray, FloatArray]:
    """Return offsets in cells to four deviations, and their weights by a Gaussian with a deviation in cells."""
    offset = np.arange(-np.ceil(4.0 * n_cells), np.ceil(4.0 * n_cells) + 1.0)
    return offset, np.exp(-0.5 * (offset / n_cells) ** 2)


def cell_outline(cells: BoolArray, dem: Dem) -> shapely.Geometry:
    """Return ground that holds the marked cells and half a cell around them, smoothed outwards only.

    Beyond that half cell, slopes interpolated between cell centres are those of open cells alone.
    """
    shapes = rasterio.features.shapes(cells.astype(np.uint8), mask=cells, transform=dem.transform)
    union = shapely.union_all([shapely.geometry.shape(geometry) for geometry, _ in shapes])
    # Simplification takes away up to a quarter of a cell, so the outline is moved out by as much.
    tolerance = 0.25 * dem.step_m
    return shapely.simplify(union.buffer(0.5 * dem.step_m + tolerance, join_style="mitre"), 0.95 * tolerance)


Reason = Literal["too steep", "too rough", "height unknown", "too narrow", "cut off"]


@dataclass(frozen=True)
class LeftOut:
    """Piece of the area where the rover cannot be, and why.

    `polygon`: outline in the area's CRS [m]. `reason`: why it is left out. `map_scale`: grid metres for each
    metre on the ground, where this differs from 1 by more than 1 %.
    """

    polygon: Polygon
    reason: Reason
    map_scale: float = 1.0

    @property
    def area_m2(self) -> float:
        """Area on the ground [m²]."""
        return float(self.polygon.area) / self.map_scale**2

    def __str__(self) -> str:
        """Return area, place and reason in half a sentence."""
        x, y = self.polygon.representative_point().coords[0]
        return f"{self.area_m2:.0f} m² around ({x:.1f}, {y:.1f}) ({self.reason})"


@dataclass(frozen=True)
class Drivable:
    """Ground that can be surveyed, and the pieces of the area that cannot.

    `ground`: where rovers may be. `left_out`: the rest of the area, by reason.
    """

    ground: FreeGround
    left_out: tuple[LeftOut, ...]

    def within(self, area: SurveyArea) -> SurveyArea:
        """Return the area cut to the ground."""
        if _same(self.ground.polygon, area.free):
            return area
        starts = self.ground.inside(area.starts) if len(area.starts) else area.starts
        return SurveyArea(self.ground.polygon, area.crs, (), starts, area.reference)

    def left_out_share(self, area: SurveyArea) -> float:
        """Return the share of the area's free ground that is left out.

        Returns: between 0 and 1.
        """
        return float(sum(piece.polygon.area for piece in self.left_out)) / float(area.free.area)

    def __str__(self) -> str:
        """List the three largest pieces that are left out, with place and reason."""
        return listed(list(self.left_out))


def listed(pieces: list[LeftOut]) -> str:
    """Return a list of the three largest pieces, and how many more there are."""
    largest = sorted(pieces, key=lambda piece: -piece.polygon.area)
    rest = f" and {len(pieces) - 3} more" if len(pieces) > 3 else ""
    return ", ".join(str(piece) for piece in largest[:3]) + rest


_ROUNDING_M = 1e-6


def drivable(
    area: SurveyArea, limits: RoverLimits | None = None, dem: Dem | None = None, *, reach_all: bool = False
) -> Drivable:
    """Return the area's free ground that a rover can drive on.

    A cell of the DEM is closed when its slope exceeds ``min(max pitch, max roll)``,
    when it is too rough or when its height or a neighbour's is unknown. Closed cells
    are closed as squares with half a cell around them, and their outlines are simplified outwards
    only: nowhere on the ground does the slope between cell centres exceed the limit.

    Slopes are those of the DEM's cells: steps smaller than a cell, crevasses and boulders
    are not seen. Those of a stated product are read over the scale of `slope_scale`. Limits are those on the ground, whatever the scale of the CRS.

    >>> area = SurveyArea.rectangle((0.0, 0.0, 100.0, 50.0), "EPSG:32608")
    >>> drivable(area, RoverLimits(clearance_m=2.0)).ground.polygon.area < area.free.area
    True
    """
    factor = settings_factor(area)
    limits, dem = in_grid_metres(limits or RoverLimits(), factor), dem_in_grid_metres(dem, factor)
    within = _free_within(limits, dem, area)
    if within.free.is_empty:
        raise InputError(
            f"no ground is left to drive on: {listed(within.left_out)}; relax the limits or move the area."
        )
    ground, cut_off = _reached(within.free, area, within.left_out)
    if cut_off and reach_all:
        raise InputError(
            f"not all of the area can be reached from its starts: {listed(cut_off)}; start a rover there or leave it out of the area."
        )
    return Drivable(ground, tuple(replace(piece, map_scale=factor) for piece in within.left_out + cut_off))


@dataclass
class _Free:
    """Ground that is still free, and what was left out of the area so far."""

    free: Polygon | MultiPolygon
    left_out: list[LeftOut]

    def close(self, closed: shapely.Geometry, reason: Reason) -> None:
        """Leave out closed ground."""
        self.left_out += _pieces(shapely.intersection(self.free, closed), reason)
        self.free = _polygonal(shapely.difference(self.free, closed))

    def narrow(self, clearance_m: float) -> None:
        """Keep a distance from every border, and leave out what is too narrow for it."""
        # Chords of round corners come nearer by half a percent, and offsets are drawn to one percent.
        offset_m = 1.015 * clearance_m
        narrowed = _polygonal(self.free.buffer(-offset_m, quad_segs=8))
        opened = narrowed.buffer(1.02 * offset_m, quad_segs=8)
        self.left_out += _pieces(shapely.difference(self.free, opened), "too narrow")
        self.free = narrowed

    def open(self, room_m: float) -> None:
        """Leave out what is too narrow to turn in."""
        opened = self.free.buffer(-room_m, quad_segs=8).buffer(room_m, quad_segs=8)
        opened = _polygonal(shapely.intersection(opened, self.free))
        self.left_out += _pieces(shapely.difference(self.free, opened), "too narrow")
        self.free = opened


def _free_within(limits: RoverLimits, dem: Dem | None, area: SurveyArea) -> _Free:
    """Return the ground of an area that is within the limits of a rover."""
    within = _Free(area.free, [])
    if limits.needs_heights:
        if dem is None:
            raise InputError(
                "the rover's limits of slope and roughness need heights; give a prior DEM of the area."
            )
        area.require_crs(dem.crs, "the DEM")
        for reason, closed in _closed_ground(dem, limits, area).items():
            within.close(closed, reason)
    if limits.clearance_m > 0.0:
        within.narrow(limits.clearance_m)
    if limits.turning_room_m > 0.0:
        within.open(limits.turning_room_m)
    if not _same(within.free, area.free):
        # Where borders cross, rounding may put a new corner outside the old border.
        within.free = _polygonal(within.free.buffer(-_ROUNDING_M, join_style="mitre"))
    return within


def _reached(
    free: Polygon | MultiPolygon, area: SurveyArea, left_out: list[LeftOut]
) -> tuple[FreeGround, list[LeftOut]]:
    """Keep the parts with a start, or the largest one, and list the others as cut off."""
    parts = sorted(shapely.get_parts(shared_ground(free).inner), key=lambda part: -part.area)
    for x, y in area.starts:
        if not any(part.dwithin(shapely.Point(x, y), 0.01) for part in parts):
            why = [str(piece) for piece in left_out if piece.polygon.covers(shapely.Point(x, y))]
            raise InputError(
                f"the start ({x:.1f}, {y:.1f}) is on ground that cannot be driven on: {(why or ['too near a border'])[0]}; move it."
            )
    home = [part for part in parts if any(part.dwithin(shapely.Point(xy), 0.01) for xy in area.starts)]
    home = home or parts[:1]
    reached = [part for part in shapely.get_parts(free) if any(part.intersects(h) for h in home)]
    away = [LeftOut(part, "cut off") for part in parts if part not in home and part.area > 1.0]
    if len(home) < len(parts):
        return FreeGround(_union(home)), away
    return shared_ground(reached[0] if len(reached) == 1 else _polygonal(shapely.union_all(reached))), away


def _same(one: Polygon | MultiPolygon, other: Polygon | MultiPolygon) -> bool:
    """Return whether two shapes are the same ground; the topology of long outlines is compared only where corners differ."""
    return bool(shapely.equals_identical(one, other)) or bool(one.equals(other))


def _union(parts: list[Polygon]) -> Polygon | MultiPolygon:
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _polygonal(shape: shapely.Geometry) -> Polygon | MultiPolygon:
    """Return the polygons of a shape; difference and intersection may leave lines and points."""
    return _union([part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"])


def _pieces(shape: shapely.Geometry, reason: Reason) -> list[LeftOut]:
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon" and part.area > 1.0]
    return [LeftOut(part, reason) for part in sorted(parts, key=lambda part: -part.area)]


def _closed_ground(dem: Dem, limits: RoverLimits, area: SurveyArea) -> dict[Reason, shapely.Geometry]:
    """Return, for each reason, the ground of the cells that are closed for it."""
    xmin, ymin, xmax, ymax = area.bounds
    scale = slope_scale(dem.step_m / settings_factor(area), limits)
    pad = max(3.0, 4.0 * scale.n_cells) * dem.step_m
    dem = dem.window((xmin - pad, ymin - pad, xmax + pad, ymax + pad))
    require_cells(dem.elevation.size)
    closed: dict[Reason, BoolArray] = {"height unknown": ~np.isfinite(dem.slope().elevation)}
    if limits.max_slope_deg is not None:
        closed["too steep"] = scale.slope_deg(dem) > limits.max_slope_deg
    if limits.max_roughness_m is not None:
        closed["too rough"] = roughness(dem) > limits.max_roughness_m
    ground: dict[Reason, shapely.Geometry] = {
        reason: cell_outline(cells, dem) for reason, cells in closed.items() if cells.any()
    }
    outside = shapely.difference(shapely.box(*area.bounds), shapely.box(*dem.bounds))
    if not outside.is_empty:
        ground["height unknown"] = shapely.union(ground.get("height unknown", Polygon()), outside)
    return ground


_TOLERANCE_M = 0.01


def on_free_ground(route: Route, free: Polygon | MultiPolygon) -> Route:
    """Return a planned route; refuse one that leaves the area less its no-go zones by more than a centimetre.

    >>> from survey import Leg
    >>> route = Route((Leg("swath", [[5.0, 5.0], [5.0, 35.0]]),), "EPSG:32608", "line")
    >>> on_free_ground(route, shapely.box(0.0, 0.0, 40.0, 40.0)).length_m
    30.0
    """
    line = route.line
    if free.covers(line):
        return route
    beyond = line.difference(free.buffer(_TOLERANCE_M, join_style="mitre"))
    if beyond.is_empty:
        return route
    x, y = shapely.get_coordinates(beyond)[0]
    raise InputError(
        f"the planned route is outside the area or in a no-go zone for {beyond.length:.2f} m, first at ({x:.1f}, {y:.1f}); "
        "nothing was planned: correct or simplify the outline there, or choose another pattern."
    )


def between_heights(
    area: SurveyArea, dem: Dem, *, above_m: float | None = None, below_m: float | None = None
) -> SurveyArea:
    """Return the ground of an area between two heights of a raster, as the tongue of a glacier is; the log states the rest.

    Cells without a height count as outside. Half a cell around each cell outside is left out too.

    >>> from affine import Affine
    >>> slope = Dem(np.repeat(np.arange(0.0, 100.0, 10.0)[:, None], 10, axis=1), Affine(10, 0, 0, 0, -10, 100), "EPSG:32608")
    >>> square = SurveyArea(shapely.box(0.0, 0.0, 100.0, 100.0), "EPSG:32608")
    >>> between_heights(square, slope, below_m=45.0).bounds[1] > 50.0
    True
    """
    area.require_crs(dem.crs, "the prior")
    low_m, high_m = -np.inf if above_m is None else above_m, np.inf if below_m is None else below_m
    outside = ~((dem.elevation >= low_m) & (dem.elevation <= high_m))
    ground = area.polygon.intersection(shapely.box(*dem.bounds))
    if outside.any():
        ground = ground.difference(cell_outline(outside, dem))
    parts = [part for part in shapely.get_parts(ground) if part.area >= dem.step_m**2]
    limits = " and ".join(
        f"{word} {limit:g} m" for word, limit in (("above", above_m), ("below", below_m)) if limit is not None
    )
    if not parts:
        known = dem.elevation[np.isfinite(dem.elevation)]
        raise InputError(
            f"no ground of the area lies {limits} of the prior (its heights are {known.min():.0f} to {known.max():.0f} m); change --above or --below."
        )
    ground = parts[0] if len(parts) == 1 else MultiPolygon(parts)
    logger.warning(
        "%.1f %% of the area lies %s; the rest is left out.", 100.0 * ground.area / area.polygon.area, limits
    )
    no_go = tuple(zone for zone in area.no_go if zone.intersects(ground))
    return SurveyArea(ground, area.crs, no_go, area.starts)


def without_marked(area: SurveyArea, mask: Dem) -> SurveyArea:
    """Return an area whose no-go zones also hold the cells of a raster that are marked, with half a cell around them.

    >>> from affine import Affine
    >>> square = SurveyArea(shapely.box(0.0, 0.0, 40.0, 40.0), "EPSG:32608")
    >>> corner = np.zeros((4, 4))
    >>> corner[0, 3] = 1.0
    >>> mask = Dem(corner, Affine(10, 0, 0, 0, -10, 40), "EPSG:32608")
    >>> bool(without_marked(square, mask).free.area < square.free.area - 100.0)
    True
    """
    area.require_crs(mask.crs, "the mask of no-go ground")
    values = mask.elevation[np.isfinite(mask.elevation)]
    if not np.isin(values, (0.0, 1.0)).all():
        raise InputError(
            f"the mask of no-go ground holds values from {values.min():g} to {values.max():g}; 1 for no-go ground and 0 "
            "elsewhere were expected."
        )
    marked = mask.elevation == 1.0
    if not marked.any():
        return area
    zones = shapely.intersection(cell_outline(marked, mask), area.polygon)
    parts = [part for part in shapely.get_parts(zones) if part.geom_type == "Polygon" and part.area > 0.0]
    return replace(area, no_go=(*area.no_go, *parts))
