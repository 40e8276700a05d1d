r"""Widest distance between swaths for which the lattice's map of LiDAR scans meets an error.

The map between two swaths is predicted by mapping it: terrain is drawn that agrees with the prior and is as rough
below its cells as the prior and the class of surface make likely. A nominal scanner is moved over it along two parallel
swaths. Its returns are mapped by the field lattice, and the map is compared with the drawn terrain. What decides
the error is therefore in it: the density of returns over range and incidence, ground that is hidden behind crests, the
noise of ranges and directions, and the lattice's interpolation.

The probability enters through the roughness: it is the one that the ground exceeds with one minus the probability.
Errors of the path are not included.

`paper_width_m` is what the EMap paper states for two passes: 3 r_m, where r_m is the largest threshold r_s for which

.. math::  \mathrm{MSE} = \frac{1}{a} \sum_a ((g - h) F_c)^2, \qquad F_c(d) = \frac{1 - \mathrm{erf}((d - r_s) / \sqrt{2})}{2}

(Eqs. 4 and 7, with the bracket of Eq. 7 closed) does not exceed the square of the error, over the nodes within the
scanner's range and with the distance d from the swath for that from the sensor.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from numba import njit
from scipy.special import erf, ndtri

from planners.config import settings_factor
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel, posterior_in_grid
from planners.prediction.places import spread_places
from planners.swaths.reference_lines import axes_of, narrowest_heading
from survey import CapacityError, Dem, Grid, InputError, SurfacePoints, SurveyArea
from survey.core import Bounds, FloatArray, Progress, stream
from survey.data.sensors.lidar import Scanner
from survey.reconstruction.gp.engines.regression import MEMORY_MB
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.terrain import ice_micro_relief
from survey.terrain.random_fields import CoarseCells, ConditionalTerrain, spectral_field

N_PATCHES = 6
"""Pieces of terrain that are drawn, spread over the area."""
_HALF_LENGTH_M, _VIEW_M, _MARGIN_M = 20.0, 50.0, 10.0
"""Half the length of the judged ground, how far before and behind it scans are taken, and the lattice's rim [m]."""
_FINEST_M, _RATIO = 5.0, 1.05
"""Smallest distance between swaths, and the factor between those that are tried."""
_PADDING_CELLS, _BYTES_PER_NODE = 8.0, 80.0
_SEED = 61


@dataclass(frozen=True, kw_only=True)
class LidarSurvey:
    """A spinning LiDAR on a rover, and the lattice that maps its scans.

    Parameters
    ----------
    scanner : Scanner
        Beams, mounting and stated errors.
    scan_step_m : float
        Distance driven between two recorded turns [m].
    nearest_m, farthest_m : float
        Ranges between which returns are mapped [m].
    reach_m : float
        Range at which ground that faces the scanner still returns a pulse [m].
    mounting_sigma_deg : float
        Error of the mounting about each axis [deg].
    node_step_m : float
        Distance between the nodes of the lattice [m].
    """

    scanner: Scanner
    scan_step_m: float
    nearest_m: float = 3.0
    farthest_m: float = 80.0
    reach_m: float = 250.0
    mounting_sigma_deg: float = 0.03
    node_step_m: float = 2.0


class LidarSpacing(NamedTuple):
    """Distance between swaths that a LiDAR allows, and what is predicted of the map.

    `spacing_m`: widest distance between swaths [m]. `rmse_m`: error of the map that is not exceeded with the probability
    [m]. `range_m`: distance from a single swath up to which the map's error is within the wish [m]. `paper_width_m`: 3 r_m
    of the EMap paper [m].
    """

    spacing_m: float
    rmse_m: float
    range_m: float
    paper_width_m: float


def widest_spacing(
    area: SurveyArea,
    prior: Dem,
    survey: LidarSurvey,
    wish_m: float,
    *,
    heading_deg: float | None = None,
    probability: float = 0.9,
    assumed: MapAssumptions | None = None,
    progress: Progress | None = None,
) -> LidarSpacing:
    """Find the widest distance between swaths for which the map meets an error.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    prior : Dem
        Coarse elevations.
    survey : LidarSurvey
        Scanner, scans per metre and lattice.
    wish_m : float
        Root mean square error that the map may have [m].
    heading_deg : float, optional
        Direction of the swaths, counter-clockwise from east [deg]; across the narrowest width by default.
    probability : float
        Probability with which the error is met.
    assumed : MapAssumptions, optional
        Error of the prior and the class of surface.
    progress : callable, optional
        Called with what is done, how much of it, and of how much.

    Returns
    -------
    LidarSpacing
        The spacing, and the prediction. Where no spacing meets the error, the smallest one that is tried, with its error.

    Raises
    ------
    InputError
        A prior with too few cells, or a CRS whose metres are not those of the ground.
    """
    if settings_factor(area) != 1.0:
        raise InputError(
            f"the CRS {area.crs.name} has metres that differ from those of the ground by more than 1 %, so that ranges of a "
            "scanner do not fit; plan in a UTM zone (--crs)."
        )
    if heading_deg is None:
        heading_deg = narrowest_heading(area.free)
    model = SpacingModel.of(
        area, prior, survey, heading_deg=heading_deg, probability=probability, assumed=assumed
    )
    ladder = model.ladder_m
    errors: dict[int, float] = {}

    def meets(k: int) -> bool:
        errors[k] = model.rmse_m(float(ladder[k]))
        if progress is not None:
            progress("predicting the map between swaths", len(errors), int(np.ceil(np.log2(len(ladder)))) + 1)
        return errors[k] <= wish_m

    if not meets(0):
        return LidarSpacing(float(ladder[0]), errors[0], 0.0, 0.0)
    low, high = 0, len(ladder)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if meets(middle) else (low, middle)
    distance_m, squared_m2 = model.by_distance
    r_m = paper_range_m(distance_m, squared_m2, wish_m)
    return LidarSpacing(float(ladder[low]), errors[low], _range_m(distance_m, squared_m2, wish_m), 3.0 * r_m)


@dataclass(frozen=True, eq=False)
class SpacingModel:
    """Predictor of the error of the map between swaths, on drawn terrain.

    `survey`: scanner and lattice. `patches`: pieces of terrain with their frames. `width_m`: width of the area across the
    swaths [m].
    """

    survey: LidarSurvey
    patches: "tuple[_Patch, ...]"
    width_m: float

    @classmethod
    def of(
        cls,
        area: SurveyArea,
        prior: Dem,
        survey: LidarSurvey,
        *,
        heading_deg: float = 0.0,
        probability: float = 0.9,
        assumed: MapAssumptions | None = None,
    ) -> "SpacingModel":
        """Draw the terrain for an area with a prior, as rough as it is with a probability at most."""
        assumed = assumed or MapAssumptions()
        kernels = _rough_kernels(posterior_in_grid(area, prior, assumed), probability)
        axes = np.column_stack(axes_of(heading_deg))
        half = np.array([_HALF_LENGTH_M + _VIEW_M, _widest_m(survey)]) + _MARGIN_M
        step_m = 0.5 * survey.node_step_m
        reach = step_m * np.ceil(np.abs(axes) @ half / step_m)
        _require_memory(reach + (1.0 + _PADDING_CELLS) * prior.step_m, survey)
        patches = []
        for k, place in enumerate(spread_places(area, N_PATCHES)[:N_PATCHES]):
            grid = Grid((*(place - reach).tolist(), *(place + reach).tolist()), step_m, area.crs)
            rng = stream(_SEED, "lidar spacing", "terrain", k)
            patches.append(_Patch(place, axes, _drawn(grid, prior, kernels[k], assumed.prior_sigma_m, rng)))
        width_m = float(np.ptp(shapely.get_coordinates(area.free) @ axes[:, 1]))
        return cls(survey, tuple(patches), width_m)

    @property
    def ladder_m(self) -> FloatArray:
        """Distances between swaths that are tried [m]."""
        n = int(np.log(_widest_m(self.survey) / _FINEST_M) / np.log(_RATIO)) + 1
        ladder: FloatArray = _FINEST_M * _RATIO ** np.arange(float(n))
        return ladder

    def rmse_m(self, spacing_m: float) -> float:
        """Return the root mean square error over the area with swaths so far apart [m].

        The outermost swaths are half a spacing from the border, beyond which there are none.
        """
        n = max(int(np.ceil(self.width_m / spacing_m - 1e-9)), 1)
        between, beside = [], []
        for k in range(len(self.patches)):
            across, squared = self._errors(k, np.array([-0.5, 0.5]) * spacing_m)
            inside = np.abs(across) <= 0.5 * spacing_m
            between.append(float(squared[inside].mean()))
            beside.append(float(squared[~inside & (np.abs(across) <= spacing_m)].mean()))
        share = 1.0 / n
        return float(np.sqrt((1.0 - share) * np.mean(between) + share * np.mean(beside)))

    @cached_property
    def by_distance(self) -> tuple[FloatArray, FloatArray]:
        """Distances (K,) from a single swath [m], and the mean squared errors (K,) of the map there [m²]."""
        step = self.survey.node_step_m
        edges = np.arange(0.0, 0.5 * _widest_m(self.survey) + step, step)
        total, count = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1)
        for k in range(len(self.patches)):
            across, squared = self._errors(k, np.zeros(1))
            total += np.histogram(np.abs(across), edges, weights=squared)[0]
            count += np.histogram(np.abs(across), edges)[0]
        return 0.5 * (edges[1:] + edges[:-1]), total / np.maximum(count, 1.0)

    def _errors(self, k: int, offsets_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distance across [m] and squared error [m²] of nodes about swaths at offsets of a patch."""
        patch = self.patches[k]
        half_m = float(np.ptp(offsets_m)) or 0.5 * _widest_m(self.survey)
        model = self._mapped(k, offsets_m, half_m, self._config)
        nodes = model.full_grid().xy
        along, across = patch.local(nodes).T
        judged = (np.abs(along) <= _HALF_LENGTH_M) & (np.abs(across) <= half_m)
        error = model.predict(nodes[judged]) - patch.terrain.at(nodes[judged])
        known = np.isfinite(error)
        return across[judged][known], np.square(error[known])

    def _mapped(
        self, k: int, offsets_m: FloatArray, half_m: float, config: FieldLatticeConfig
    ) -> FieldLattice:
        """Map a patch from the scans along swaths at offsets [m], up to a distance across [m]."""
        patch, step = self.patches[k], self.survey.node_step_m
        corners = patch.world(_CORNERS * [_HALF_LENGTH_M, half_m])
        low = step * np.floor((corners.min(axis=0) - _MARGIN_M) / step)
        high = step * np.ceil((corners.max(axis=0) + _MARGIN_M) / step)
        bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        points = _scanned(patch, self.survey, offsets_m, bounds, stream(_SEED, "lidar spacing", "noise", k))
        return FieldLattice(config, bounds).fit(points)

    @cached_property
    def _config(self) -> FieldLatticeConfig:
        """The lattice with what it learns of the ground's stiffness on the first and the last patch.

        Heights depend on the stiffness times the square of the factor on the points' errors.
        """
        learning = FieldLatticeConfig(step_m=self.survey.node_step_m, n_draws=0, calibrate=False, gate=False)
        offsets_m = np.array([-0.5, 0.5]) * _LEARNED_M
        learned = [
            self._mapped(k, offsets_m, _LEARNED_M, learning).stiffness_ for k in (0, len(self.patches) - 1)
        ]
        stiffness, range_m = (
            float(np.exp(np.mean(np.log(each))))
            for each in zip(
                *((one.stiffness * one.noise_factor**2, one.range_m) for one in learned), strict=True
            )
        )
        return learning.model_copy(update={"stiffness": stiffness, "range_m": range_m})


_CORNERS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
_LEARNED_M = 30.0


class _Patch(NamedTuple):
    """Drawn terrain about a place (2,) [m], with the swaths' axes (2, 2): along and across in its columns."""

    place: FloatArray
    axes: FloatArray
    terrain: Dem

    def world(self, local: FloatArray) -> FloatArray:
        """Return places (N, 2) from distances along and across [m]."""
        placed: FloatArray = self.place + local @ self.axes.T
        return placed

    def local(self, xy: FloatArray) -> FloatArray:
        """Return distances along and across (N, 2) of places [m]."""
        turned: FloatArray = (xy - self.place) @ self.axes
        return turned


def paper_range_m(distance_m: FloatArray, squared_m2: FloatArray, wish_m: float) -> float:
    """Return the range r_m of the EMap paper by its Eqs. 4 and 7 [m].

    `distance_m`, `squared_m2` (K,): distances from the swath, evenly spaced, and mean squared errors there.

    >>> paper_range_m(np.arange(0.5, 40.0), np.full(40, 0.04), 0.1)
    10.5
    """
    thresholds = np.arange(0.0, float(distance_m[-1]) + 0.5, 0.5)
    weight = 0.5 * (1.0 - erf((distance_m - thresholds[:, None]) / np.sqrt(2.0)))
    within = (weight**2 * squared_m2).mean(axis=1) <= wish_m**2
    return float(thresholds[within].max(initial=0.0))


def _range_m(distance_m: FloatArray, squared_m2: FloatArray, wish_m: float) -> float:
    """Return the distance up to which the error is within the wish [m]."""
    within = np.flatnonzero(np.cumsum(squared_m2 > wish_m**2) == 0)
    return float(distance_m[within[-1]]) if len(within) else 0.0


def _require_memory(half_m: FloatArray, survey: LidarSurvey) -> None:
    """Refuse a lattice that is too fine for pieces of terrain with these half sides (2,) [m]."""
    n_nodes = float(np.prod(4.0 * half_m / survey.node_step_m))
    if _BYTES_PER_NODE * n_nodes > MEMORY_MB * 1e6:
        raise CapacityError(
            f"nodes {survey.node_step_m:g} m apart need terrain of {n_nodes:.3g} nodes for each of {N_PATCHES} predictions, which take more than "
            f"{MEMORY_MB:g} MB; give the mission's map a larger step, or its LiDAR a shorter range."
        )


def _widest_m(survey: LidarSurvey) -> float:
    return 2.0 * survey.farthest_m


def _rough_kernels(posterior: KernelPosterior, probability: float) -> list[WeightedKernel]:
    """Return a covariance for each patch, as often as it weighs; its ground is smoother than that with the probability."""
    factor = float(np.exp(ndtri(probability) * np.hypot(posterior.spread, posterior.open_spread)))
    shares = np.cumsum([one.weight for one in posterior.kernels])[:-1]
    numbers = np.searchsorted(shares, (np.arange(N_PATCHES) + 0.5) / N_PATCHES)
    chosen = [posterior.kernels[k] for k in numbers.tolist()]
    return [
        one._replace(variance_m2=factor**2 * one.variance_m2, unseen_m2=factor**2 * one.unseen_m2)
        for one in chosen
    ]


def _drawn(grid: Grid, prior: Dem, one: WeightedKernel, sigma_m: float, rng: np.random.Generator) -> Dem:
    """Draw terrain that agrees with the cells of a prior.

    Waves longer than the drawn piece and eight cells come from the prior alone. The correction that makes a free draw agree
    with the cells has no waves shorter than them, so that it is found on nodes a quarter of a cell apart.
    """
    xmin, ymin, xmax, ymax = grid.bounds
    cell = prior.step_m
    try:
        near = prior.window((xmin - cell, ymin - cell, xmax + cell, ymax + cell))
        cells = CoarseCells(near, sigma_m)
    except InputError:
        cells = CoarseCells(prior, sigma_m)
    coarse = _around(grid, cells.prior)
    wide = Grid(coarse.bounds, grid.step_m, grid.crs)
    waves, _ = spectral_field(wide, rng, one.kernel.spectral_density, padding_m=_PADDING_CELLS * cell)
    free = Dem.on(wide, waves)
    agreeing = ConditionalTerrain(cells, one.kernel, coarse).conditioned(free, rng)
    change = Dem.on(coarse, agreeing.elevation - free.at(coarse.xy).reshape(coarse.shape))
    heights = free.at(grid.xy) + change.at(grid.xy)
    relief = ice_micro_relief(grid, rng, sd_m=float(np.sqrt(one.unseen_m2)))
    return Dem.on(grid, heights.reshape(grid.shape) + relief)


def _around(grid: Grid, cells: Dem) -> Grid:
    """Return nodes a quarter of a cell apart over a grid and over the cells, which reach half a cell beyond their centres."""
    ours, theirs = np.array(grid.bounds), np.array(cells.bounds)
    step_m = grid.step_m * max(round(0.25 * cells.step_m / grid.step_m), 1)
    low, high = np.minimum(ours[:2], theirs[:2]) - step_m, np.maximum(ours[2:], theirs[2:]) + step_m
    n = np.ceil((high - low) / step_m)
    return Grid((*low.tolist(), *(low + n * step_m).tolist()), step_m, grid.crs)


def _scanned(
    patch: _Patch, survey: LidarSurvey, offsets_m: FloatArray, bounds: Bounds, rng: np.random.Generator
) -> SurfacePoints:
    """Return the returns of scans along swaths at offsets [m] within bounds, each swath driven against the one before."""
    scanner, parts = survey.scanner, []
    tilt = np.radians(survey.mounting_sigma_deg) * rng.standard_normal(2)
    along = np.arange(-_HALF_LENGTH_M - _VIEW_M, _HALF_LENGTH_M + _VIEW_M, survey.scan_step_m)
    for k, offset in enumerate(offsets_m.tolist()):
        sensor, slope = _sensors(patch, np.column_stack([along, np.full(len(along), offset)]), survey)
        found = _returns(patch.terrain, survey, sensor, slope)
        found = found[(found[:, :2] >= bounds[:2]).all(axis=1) & (found[:, :2] <= bounds[2:]).all(axis=1)]
        ray = found[:, :3] - sensor[found[:, 3].astype(np.int64)]
        sigma_m = height_sigma_m(ray, scanner)
        ahead = (-1.0) ** k * (ray[:, :2] @ patch.axes)
        found[:, 2] += sigma_m * rng.standard_normal(len(ray)) + ahead @ tilt
        parts.append(np.column_stack([found[:, :3], sigma_m]))
    points = np.concatenate(parts)
    return SurfacePoints(points[:, :3], sigma_m=points[:, 3], crs=patch.terrain.crs)


def height_sigma_m(ray: FloatArray, scanner: Scanner) -> FloatArray:
    """Return the standard deviations of the heights of returns by the errors of range and direction [m].

    `ray` (N, 3): places of the returns from the scanner [m].

    >>> height_sigma_m(np.array([[0.0, 0.0, -2.0]]), Scanner(elevation_deg=(0.0,), n_columns=4)).tolist()
    [0.03]
    """
    level_m = np.hypot(ray[:, 0], ray[:, 1])
    along = scanner.range_sigma_m * ray[:, 2] / np.hypot(level_m, ray[:, 2])
    sigma_m: FloatArray = np.hypot(along, np.radians(scanner.angle_sigma_deg) * level_m)
    return sigma_m


def _sensors(patch: _Patch, local: FloatArray, survey: LidarSurvey) -> tuple[FloatArray, FloatArray]:
    """Return places (N, 3) of the scanner [m], which stands square to the ground, and the ground's slopes (N, 2)."""
    xy, reach = patch.world(local), patch.terrain.step_m * np.eye(2)
    slope = np.column_stack(
        [
            (patch.terrain.at(xy + to) - patch.terrain.at(xy - to)) / (2.0 * patch.terrain.step_m)
            for to in reach
        ]
    )
    height_m = survey.scanner.mount_m[2]
    return np.column_stack([xy - height_m * slope, patch.terrain.at(xy) + height_m]), slope


def _returns(terrain: Dem, survey: LidarSurvey, sensor: FloatArray, slope: FloatArray) -> FloatArray:
    """Return places and number of the scan (N, 4) of the returns of scans."""
    (xmin, ymin, *_), scanner = terrain.grid().bounds, survey.scanner
    azimuth = 2.0 * np.pi * np.arange(scanner.n_columns) / scanner.n_columns
    limits = np.array([survey.nearest_m, survey.farthest_m, survey.reach_m, terrain.step_m])
    local = sensor - [xmin, ymin, 0.0]
    found = _follow(
        np.ascontiguousarray(terrain.elevation[::-1]),
        np.column_stack([local, slope]),
        azimuth,
        np.sort(np.radians(scanner.elevation_deg)),
        limits,
    )
    found[:, :2] += [xmin, ymin]
    return found


@njit(cache=True)
def _follow(
    z: FloatArray, sensors: FloatArray, azimuth: FloatArray, elevation: FloatArray, limits: FloatArray
) -> FloatArray:
    """Follow the beams of each column outwards; each ends where the ground first rises above it.

    `sensors` (S, 5): place [m] and slope of the ground, which tilts the scanner. Returns (N, 4).
    """
    nearest_m, farthest_m, reach_m, step_m = limits
    n_north, n_east = z.shape
    found = np.empty((len(sensors) * len(azimuth) * len(elevation), 4))
    n = 0
    for s in range(len(sensors)):
        x, y, top, to_east, to_north = sensors[s]
        for a in azimuth:
            east, north = np.cos(a), np.sin(a)
            tilt = np.arctan(to_east * east + to_north * north)
            k, r, before = 0, step_m, top
            while r <= farthest_m and k < len(elevation):
                u, v = (x + east * r) / step_m, (y + north * r) / step_m
                i, j = int(np.floor(u)), int(np.floor(v))
                if i < 0 or j < 0 or i >= n_east - 1 or j >= n_north - 1:
                    break
                u, v = u - i, v - j
                ground = (z[j, i] * (1.0 - u) + z[j, i + 1] * u) * (1.0 - v) + (
                    z[j + 1, i] * (1.0 - u) + z[j + 1, i + 1] * u
                ) * v
                while k < len(elevation) and top + np.tan(elevation[k] + tilt) * r <= ground:
                    t = np.tan(elevation[k] + tilt)
                    above, below = top + t * (r - step_m) - before, ground - top - t * r
                    share = max(above, 0.0) / max(max(above, 0.0) + below, 1e-9) if r > step_m else 1.0
                    met = r - step_m + share * step_m
                    cos = 1.0 / np.sqrt(1.0 + t * t)
                    rise = (ground - before) / step_m if r > step_m else 0.0
                    facing = abs(rise - t) * cos / np.sqrt(1.0 + rise * rise)
                    if nearest_m <= met / cos <= min(farthest_m, reach_m * np.sqrt(facing)):
                        found[n, 0], found[n, 1] = x + east * met, y + north * met
                        found[n, 2], found[n, 3] = top + t * met, s
                        n += 1
                    k += 1
                before = ground
                r += step_m
    return found[:n]
