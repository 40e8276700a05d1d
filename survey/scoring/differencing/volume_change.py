"""Elevation and volume change over outlines, with errors carried over from unchanged ground.

`Change` is the result of a comparison: difference, standard deviation, significance, and a `VolumeChange` for
each outline, from which mass follows by a density. `ComparedGround` rasterizes the outlines and the ground that
did not change. `OutlineVolumes` integrates a difference over outlines; the error of a mean follows from the
variogram. The notes state assumptions that a reader has to check.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon, Polygon

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    printable,
)
from survey.core.map_scale import MapScale, areal_factors, ground_area_m2
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.scoring.accuracy import NMAD_FACTOR, ErrorStatistics
from survey.scoring.differencing.coregistration import SurveyAlignment
from survey.scoring.differencing.hypsometry import ElevationBand, Hypsometry
from survey.scoring.differencing.variogram import SumErrors, Variogram

SIGNIFICANT = 1.959964
"""A change beyond this many standard deviations is called significant."""
WATER_KG_M3 = 1000.0


class MassBalance(NamedTuple):
    """Change of mass, and its water equivalent per area.

    `mass_kg`, `mass_std_kg`: mass gained, negative when lost, and its standard deviation [kg].
    `specific_m_we`, `specific_std_m_we`: specific mass balance and its standard deviation [m water
    equivalent].
    """

    mass_kg: float
    mass_std_kg: float
    specific_m_we: float
    specific_std_m_we: float


@dataclass(frozen=True)
class VolumeChange:
    """Change of height and volume within one outline.

    Parameters
    ----------
    name : str
        Name of the outline.
    area_m2 : float
        Its area on the ground [m²].
    known_share : float
        Share of it that both surveys map; the rest is filled by elevation bands (`Hypsometry`).
    mean_m : float
        Mean change of height, positive when the surface rose [m].
    volume_m3, std_m3 : float
        Change of volume on the ground and its standard deviation, with the errors' correlation [m³].
    half_width_95_m3 : float
        Half of its 95 % interval [m³].
    naive_std_m3 : float
        Standard deviation if the errors of all cells were independent [m³]; far too small.
    void_std_m3 : float
        Part of `std_m3` that comes from what the surveys do not map [m³].
    bands : tuple of ElevationBand
        Change by elevation, from the lowest band up; none where the surveys are terrain models.
    identifier : str
        Its identifier in an inventory of glaciers; empty where there is none.
    """

    name: str
    area_m2: float
    known_share: float
    mean_m: float
    volume_m3: float
    std_m3: float
    half_width_95_m3: float
    naive_std_m3: float
    void_std_m3: float = 0.0
    bands: tuple[ElevationBand, ...] = ()
    identifier: str = ""

    def mass(self, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0) -> MassBalance:
        """Convert the volume to mass.

        Parameters
        ----------
        density_kg_m3, density_std_kg_m3 : float
            Of what was gained or lost. 850 ± 60 kg m⁻³ is Huss's (2013, The Cryosphere 7, 877–887)
            value for glaciers over five years and more, where the firn did not change and volume did
            visibly; over shorter periods give the density measured.

        Returns
        -------
        MassBalance
            With the errors of volume and density combined, taken to be independent.

        Raises
        ------
        InputError
            A density that is not positive, or a negative deviation.

        Examples
        --------
        >>> lost = VolumeChange("a", 1e6, 1.0, -2.0, -2e6, 1e5, 2e5, 1e3)
        >>> lost.mass().specific_m_we, round(lost.mass().specific_std_m_we, 3)
        (-1.7, 0.147)
        """
        if not (np.isfinite(density_kg_m3) and density_kg_m3 > 0.0 and density_std_kg_m3 >= 0.0):
            raise InputError(
                f"the density is {density_kg_m3} ± {density_std_kg_m3} kg/m³; a positive one was expected."
            )
        mass = density_kg_m3 * self.volume_m3
        std = float(np.hypot(density_kg_m3 * self.std_m3, density_std_kg_m3 * self.volume_m3))
        per_area = WATER_KG_M3 * self.area_m2
        return MassBalance(mass, std, mass / per_area, std / per_area)


class FlowBalance(NamedTuple):
    """Change within one outline with the flow of the ice taken out.

    `name`: name of the outline. `along_mean_m`, `along_std_m`: mean change of height along the flow, of the
    surface that the outline held at the earlier survey, and its standard deviation [m]. `flux_divergence_m`,
    `flux_divergence_std_m`: mean thickness of ice that the flow carried out of the outline, and its standard
    deviation [m]. `balance_m`, `balance_std_m`: mean gain at surface and bed, change at fixed places plus
    flux divergence, and its standard deviation [m of ice]. `thickness_m`: mean thickness of the ice [m].
    """

    name: str
    along_mean_m: float
    along_std_m: float
    flux_divergence_m: float
    flux_divergence_std_m: float
    balance_m: float
    balance_std_m: float
    thickness_m: float


@dataclass(frozen=True, eq=False, repr=False)
class AlongFlow(DataObject):
    """Change of a surface that moves, followed along its flow (Lagrangian).

    `difference`: height after the displacement minus height before, at places of the earlier survey [m].
    `std_m` (H, W): standard deviation of each cell's difference, that of the displacement included [m].
    `shift_m` (2, H, W): displacement to the east and to the north [m]. `shift_std_m` (2, H, W): its standard
    deviations [m]. `balances`: one for each outline.
    """

    difference: Dem
    std_m: FloatArray
    shift_m: FloatArray
    shift_std_m: FloatArray
    balances: tuple[FlowBalance, ...]


class StableLevel(NamedTuple):
    """Level of the difference on the unchanged ground.

    `median_m`, `mean_m`: median, and mean without blunders [m]. `excess_m`: standard deviation of the median beyond that of
    the mean, and so of the difference of both [m].
    """

    median_m: float
    mean_m: float
    excess_m: float

    @property
    def disagrees(self) -> bool:
        """Whether median and mean differ by more than their errors, as where the differences are skewed."""
        return abs(self.median_m - self.mean_m) > SIGNIFICANT * self.excess_m


Outlines = Mapping[str, Polygon | MultiPolygon]


class ComparedGround(NamedTuple):
    """Masks (H, W) of the outlines and of the unchanged ground on a grid."""

    grid: Grid
    outlines: Outlines
    inside: tuple[BoolArray, ...]
    stable: BoolArray

    @classmethod
    def of(cls, grid: Grid, outlines: Outlines, stable: Polygon | MultiPolygon | None) -> "ComparedGround":
        """Rasterize outlines; without `stable`, all ground outside them counts as unchanged.

        Outlines beyond the grid have no cells; where all are, they are refused.
        """
        inside = tuple(_cells_within(grid, shape) for shape in outlines.values())
        if outlines and not any(mask.any() for mask in inside):
            name, shape = next(iter(outlines.items()))
            raise InputError(
                f"the outline {name!r} ({shape.area:.0f} m²) holds no cell of the surveys' common grid; check that they overlap."
            )
        rest = ~np.logical_or.reduce(inside) if inside else np.ones(grid.shape, dtype=bool)
        if stable is not None:
            rest &= _cells_within(grid, stable)
        return cls(grid, outlines, inside, rest)


def _cells_within(grid: Grid, shape: Polygon | MultiPolygon) -> BoolArray:
    """Return the cells (H, W) whose centres lie in a polygon."""
    west, south, east, north = shape.bounds
    columns = np.flatnonzero((grid.x >= west) & (grid.x <= east))
    rows = np.flatnonzero((grid.y >= south) & (grid.y <= north))
    inside = np.zeros(grid.shape, dtype=bool)
    if rows.size and columns.size:
        x, y = grid.x[columns][None], grid.y[rows][:, None]
        inside[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = shapely.contains_xy(shape, x, y)
    return inside


@dataclass(frozen=True, eq=False, repr=False)
class Change(DataObject):
    """Change of a surface between two surveys.

    Parameters
    ----------
    difference : Dem
        Later minus earlier [m].
    std_m : (H, W) ndarray
        Standard deviation of each cell's difference [m].
    significant : (H, W) ndarray of int8
        1 where the surface rose significantly at the 95 % level, -1 where it sank, 0 elsewhere. One in
        twenty cells that did not change is called significant too.
    volumes : tuple of VolumeChange
        One for each outline that both surveys map by a half or more.
    method : str
        ``joint posterior`` of two terrain models, or ``variogram`` of the unchanged ground.
    offset_m : float
        Median difference of the unchanged ground, which was subtracted [m].
    n_stable : int
        Cells of unchanged ground; 0 for the joint posterior.
    alignment : SurveyAlignment, optional
        Shift, tilt and bias by curvature of the earlier surface, which were corrected.
    variogram : Variogram, optional
        Of the errors of the difference; distances on the ground.
    notes : tuple of str
        Assumptions behind the figures.
    along_flow : AlongFlow, optional
        Change along the flow of the ice, where a flow was given; `difference` is that at fixed places.
    level : StableLevel, optional
        Median and mean of the unchanged ground, where it was used.
    total : VolumeChange, optional
        All outlines together, where there are several that do not overlap.
    """

    difference: Dem
    std_m: FloatArray
    significant: npt.NDArray[np.int8]
    volumes: tuple[VolumeChange, ...]
    method: str
    offset_m: float = 0.0
    n_stable: int = 0
    alignment: SurveyAlignment | None = None
    variogram: Variogram | None = None
    notes: tuple[str, ...] = ()
    along_flow: AlongFlow | None = None
    level: StableLevel | None = None
    total: VolumeChange | None = None

    @cached_property
    def statistics(self) -> ErrorStatistics:
        """Statistics of the difference on all ground that both surveys map."""
        known = self.difference.elevation
        return ErrorStatistics.of(known[np.isfinite(known)])

    @cached_property
    def map_scale(self) -> MapScale:
        """Scale factors of the CRS over the raster, by which areas and volumes were divided."""
        return MapScale.over(self.difference.crs, self.difference.bounds)


def significance(difference: FloatArray, std_m: FloatArray) -> npt.NDArray[np.int8]:
    """Return 1 where the surface rose significantly (H, W), -1 where it sank, 0 elsewhere."""
    beyond = np.abs(difference) > SIGNIFICANT * std_m
    return np.where(beyond, np.sign(np.nan_to_num(difference)), 0.0).astype(np.int8)


BLUNDER = 5.0
"""Unchanged cells farther from their median than this many robust deviations hold blunders, not errors."""
_N_LEAST_STABLE = 100


def remove_blunders(difference: FloatArray, stable: BoolArray) -> BoolArray:
    """Return the unchanged cells (H, W) without blunders."""
    if stable.sum() < _N_LEAST_STABLE:
        raise InputError(
            f"both surveys know {int(stable.sum())} cells of unchanged ground; {_N_LEAST_STABLE} are needed to learn their errors, "
            "survey some ground around the outline, or compare two terrain models (.npz)."
        )
    e = difference[stable]
    spread = max(float(NMAD_FACTOR * np.median(np.abs(e - np.median(e)))), 1e-9)
    calm: BoolArray = stable & (np.abs(np.where(stable, difference, 0.0) - np.median(e)) <= BLUNDER * spread)
    return calm


# Neighbours that share more than this part of their cells overlap.
_SHARED_CELLS = 0.001
LEAST_KNOWN_SHARE = 0.5
"""An outline of which both surveys map less than this share is refused."""


class ChangeErrors(NamedTuple):
    """Errors of a difference raster.

    `relative` (H, W): standard deviation of each cell relative to the mean. `known`, `unchanged` (H, W) bool:
    cells that both surveys map, and those from which the errors were estimated. `variogram`: of the errors
    over their relative deviation; distances on the ground. `design` (K, H, W): how each correction that was estimated on
    the unchanged ground changes the difference: level, shift, tilt, bias by curvature. `has_median`: the level is a median.
    """

    relative: FloatArray
    known: BoolArray
    unchanged: BoolArray
    variogram: Variogram
    design: FloatArray
    has_median: bool


class Corrections:
    r"""Errors of what was estimated on the unchanged ground and corrected everywhere.

    The corrections are linear in the errors of the unchanged ground, :math:`(X^T W X)^{-1} X^T W e` with the columns X of
    the design and weights W of the inverse variances; so is their part in any sum, and no derivative is left out.

    `errors`: of the difference. `step_m`: width of a cell on the ground [m].
    """

    def __init__(self, errors: ChangeErrors, step_m: float) -> None:
        self.errors = errors
        used = errors.unchanged & np.isfinite(errors.design).all(axis=0)
        self._weights = np.where(used, 1.0 / errors.relative**2, 0.0)
        self._columns = np.where(used, errors.design, 0.0)
        normal = np.einsum("kij,lij,ij->kl", self._columns, self._columns, self._weights)
        self._inverse = np.linalg.pinv(normal, hermitian=True)
        self.sums = SumErrors(errors.variogram, errors.unchanged, step_m)

    def weights_of(self, factors: FloatArray) -> FloatArray:
        """Return the weights (H, W) of the unchanged ground's differences in the sum of corrections times (K,)."""
        found: FloatArray = np.tensordot(self._inverse @ factors, self._columns, 1) * self._weights
        return found

    def stds(self) -> list[float]:
        """Return the standard deviation of each correction (K,)."""
        units = np.eye(len(self._inverse))
        return [self.sums.of(self.weights_of(unit) * self.errors.relative).std for unit in units]

    def error_weights(self, weights: FloatArray) -> FloatArray:
        """Return the weights (H, W) of the errors of all cells in a mean with the weights (H, W), less the corrections in it."""
        total = weights
        if len(self._inverse):
            seen = np.where(np.isfinite(self.errors.design).all(axis=0), weights, 0.0)
            factors = np.nansum(self.errors.design * seen, axis=(1, 2)) / max(float(seen.sum()), 1e-300)
            total = weights - self.weights_of(factors)
        return np.where(self.errors.known, total * self.errors.relative, 0.0)

    @cached_property
    def median_excess_m(self) -> float:
        """Standard deviation that the level has because it is a median [m]; 0 where it is none."""
        if not self.errors.has_median:
            return 0.0
        root = np.sqrt(self._weights)
        return self.sums.median_excess_m(root / self._weights.sum())


class OutlineVolumes:
    """Integrals of a difference raster over outlines.

    `difference`: later minus earlier [m]. `heights` (H, W): of the ground, for elevation bands [m]. `corrections`: with the
    errors of the difference. `ground`: outlines.
    """

    def __init__(
        self, difference: Dem, heights: FloatArray, corrections: Corrections, ground: ComparedGround
    ) -> None:
        self.difference = difference
        self.corrections = corrections
        self.errors = corrections.errors
        grid = difference.grid()
        areas = difference.step_m**2 / areal_factors(grid.crs, grid.x, grid.y)
        within = np.logical_or.reduce(ground.inside) if ground.inside else np.zeros(grid.shape, dtype=bool)
        self._hypsometry = Hypsometry(heights, difference.elevation, areas, self.errors.known, within)

    def over(self, name: str, shape: Polygon | MultiPolygon, inside: BoolArray) -> VolumeChange:
        """Return the change over an outline whose cells are `inside` (H, W)."""
        on_raster = float(shape.intersection(shapely.box(*self.difference.bounds)).area / shape.area)
        on_raster = 1.0 if on_raster > 1.0 - 1e-9 else on_raster
        share = self._known_share(name, inside) * on_raster
        if share < LEAST_KNOWN_SHARE:
            raise InputError(
                f"both surveys map {share:.0%} of the outline {name!r}; {LEAST_KNOWN_SHARE:.0%} are needed for a volume."
            )
        filled = self._hypsometry.mean_over(inside, 1.0 - on_raster)
        area = ground_area_m2(self.difference.crs, shape)
        found = self._change(name, area, share, filled.weights, filled.void_std_m)
        return replace(found, bands=filled.bands)

    def together(self, found: Sequence[tuple[VolumeChange, BoolArray]]) -> VolumeChange | None:
        """Return the change over several outlines with their cells (H, W); None where there is one, or two overlap."""
        cells = sum(
            (inside.astype(np.int64) for _, inside in found), np.zeros(self.difference.shape, np.int64)
        )
        if len(found) < 2 or (cells > 1).sum() > _SHARED_CELLS * (cells > 0).sum():
            return None
        areas = np.array([one.area_m2 for one, _ in found])
        beyond = [self._hypsometry.mean_over(inside, 0.0).weights for _, inside in found]
        weights = sum(share * one for share, one in zip(areas / areas.sum(), beyond, strict=True))
        share = float(np.average([one.known_share for one, _ in found], weights=areas))
        void_m = sum(one.void_std_m3 for one, _ in found) / float(areas.sum())
        return self._change("all outlines", float(areas.sum()), share, np.asarray(weights), void_m)

    def _change(
        self, name: str, area_m2: float, share: float, weights: FloatArray, void_m: float
    ) -> VolumeChange:
        """Return the change with the mean of weights (H, W), to whose error voids add a standard deviation [m]."""
        used = weights > 0.0
        mean = float(weights[used] @ self.difference.elevation[used])
        error = self.corrections.sums.of(self.corrections.error_weights(weights))
        # Errors of a median and of voids are independent of those of the mapped cells' mean.
        other = float(np.hypot(void_m, self.corrections.median_excess_m))
        naive = np.sqrt(
            self.errors.variogram.variance_m2 * ((weights * self.errors.relative)[used] ** 2).sum()
        )
        return VolumeChange(
            name,
            area_m2,
            share,
            mean,
            mean * area_m2,
            float(np.hypot(error.std, other)) * area_m2,
            float(np.hypot(error.half_width_95, SIGNIFICANT * other)) * area_m2,
            float(naive) * area_m2,
            void_m * area_m2,
        )

    def _known_share(self, name: str, inside: BoolArray) -> float:
        """Return the share of an outline's cells that both surveys map."""
        if not inside.any():
            raise InputError(f"the outline {name!r} holds no cell of the surveys' common grid.")
        return float((inside & self.errors.known).sum()) / float(inside.sum())


def ground_step_m(dem: Dem) -> float:
    """Return the mean width of a raster's cells on the ground [m]."""
    return dem.step_m / MapScale.over(dem.crs, dem.bounds).linear.mean


# Outlines that are mapped to a smaller share get a note.
_MAPPED = 0.99


def datum_notes(later: str, earlier: str) -> tuple[str, ...]:
    """Return a note for each survey that states no vertical datum."""
    return tuple(
        f"the {name} survey does not state its vertical datum; check that both count from the same"
        for name, datum in (("later", later), ("earlier", earlier))
        if not datum
    )


def scale_notes(dem: Dem) -> tuple[str, ...]:
    """Return a note where lengths in the CRS differ by more than 1 % from those on the ground."""
    warning = MapScale.over(dem.crs, dem.bounds).warning
    return (warning,) if warning else ()


def coverage_notes(volumes: Iterable[VolumeChange]) -> tuple[str, ...]:
    """Return a note for each outline of which a survey does not map a part."""
    return tuple(
        f"both surveys map {one.known_share:.0%} of {printable(one.name)}; the rest is filled with the mean change at its elevation, "
        f"which adds ± {one.void_std_m3 / one.area_m2:.3f} m to the error of the mean"
        for one in volumes
        if one.known_share < _MAPPED
    )
