"""Elevation and volume change over outlines, with errors carried over from unchanged ground, and its files.

`Change` is the result of a comparison: difference, standard deviation, significance, and a `VolumeChange` for
each outline, from which mass follows by a density. `ComparedGround` rasterizes the outlines and the ground that
did not change. `OutlineVolumes` integrates a difference over outlines; the error of a mean follows from the
variogram. The notes state assumptions that a reader has to check.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
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
from survey.scoring.accuracy import NMAD_FACTOR
from survey.scoring.differencing.coregistration import Shift
from survey.scoring.differencing.variogram import Variogram, error_of_sum

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
        Share of it that both surveys map; the rest is assumed to change like the mapped part.
    mean_m : float
        Mean change of height, positive when the surface rose [m].
    volume_m3, std_m3 : float
        Change of volume on the ground and its standard deviation, with the errors' correlation [m³].
    half_width_95_m3 : float
        Half of its 95 % interval [m³].
    naive_std_m3 : float
        Standard deviation if the errors of all cells were independent [m³]; far too small.
    """

    name: str
    area_m2: float
    known_share: float
    mean_m: float
    volume_m3: float
    std_m3: float
    half_width_95_m3: float
    naive_std_m3: float

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
        One for each outline.
    method : str
        ``joint posterior`` of two terrain models, or ``variogram`` of the unchanged ground.
    offset_m : float
        Mean difference of the unchanged ground, which was subtracted [m].
    n_stable : int
        Cells of unchanged ground; 0 for the joint posterior.
    shift : Shift, optional
        Shift of the earlier surface before the comparison.
    variogram : Variogram, optional
        Of the errors of the difference; distances on the ground.
    notes : tuple of str
        Assumptions behind the figures.
    along_flow : AlongFlow, optional
        Change along the flow of the ice, where a flow was given; `difference` is that at fixed places.
    """

    difference: Dem
    std_m: FloatArray
    significant: npt.NDArray[np.int8]
    volumes: tuple[VolumeChange, ...]
    method: str
    offset_m: float = 0.0
    n_stable: int = 0
    shift: Shift | None = None
    variogram: Variogram | None = None
    notes: tuple[str, ...] = ()
    along_flow: AlongFlow | None = None

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

Outlines = Mapping[str, Polygon | MultiPolygon]


class ComparedGround(NamedTuple):
    """Masks (H, W) of the outlines and of the unchanged ground on a grid."""

    grid: Grid
    outlines: Outlines
    inside: tuple[BoolArray, ...]
    stable: BoolArray

    @classmethod
    def of(cls, grid: Grid, outlines: Outlines, stable: Polygon | MultiPolygon | None) -> "ComparedGround":
        """Rasterize outlines; without `stable`, all ground outside them counts as unchanged."""
        if not outlines:
            raise InputError("there is no outline; name at least one polygon over which to compute change.")
        x, y = grid.xy.T
        inside = tuple(shapely.contains_xy(shape, x, y).reshape(grid.shape) for shape in outlines.values())
        for name, shape, mask in zip(outlines, outlines.values(), inside, strict=True):
            if not mask.any():
                raise InputError(
                    f"the outline {name!r} ({shape.area:.0f} m²) holds no cell of the surveys' common grid; check that they overlap."
                )
        rest = ~np.logical_or.reduce(inside)
        if stable is not None:
            rest &= shapely.contains_xy(stable, x, y).reshape(grid.shape)
        return cls(grid, outlines, inside, rest)

    def stable_on(self, dem: Dem) -> BoolArray:
        """Return the unchanged ground (H, W) on the cells of another raster."""
        stable = Dem.on(self.grid, self.stable.astype(np.float64))
        calm: BoolArray = (stable.at(dem.xy) > 0.99).reshape(dem.shape)
        return calm


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


LEAST_KNOWN_SHARE = 0.5
"""An outline of which both surveys map less than this share is refused."""


class ChangeErrors(NamedTuple):
    """Errors of a difference raster.

    `relative` (H, W): standard deviation of each cell relative to the mean. `known`, `unchanged` (H, W) bool:
    cells that both surveys map, and those from which the errors were estimated. `variogram`: of the errors
    over their relative deviation; distances on the ground. `is_levelled`: the mean difference of the
    unchanged ground was subtracted.
    """

    relative: FloatArray
    known: BoolArray
    unchanged: BoolArray
    variogram: Variogram
    is_levelled: bool


class OutlineVolumes:
    """Integrals of a difference raster over outlines.

    `difference`: later minus earlier [m]. `errors`: of the same raster.
    """

    def __init__(self, difference: Dem, errors: ChangeErrors) -> None:
        self.difference = difference
        self.errors = errors

    @cached_property
    def ground(self) -> FloatArray:
        """Ground area of each cell over its grid area (H, W)."""
        grid = self.difference.grid()
        return 1.0 / areal_factors(grid.crs, grid.x, grid.y)

    @cached_property
    def ground_step_m(self) -> float:
        """Mean width of a cell on the ground [m]."""
        return ground_step_m(self.difference)

    def over(self, name: str, shape: Polygon | MultiPolygon, inside: BoolArray) -> VolumeChange:
        """Return the change over an outline whose cells are `inside` (H, W)."""
        used = inside & self.errors.known
        share = self._known_share(name, shape, inside)
        weights = np.where(used, self.ground, 0.0)
        weights /= weights.sum()
        heights = self.difference.elevation
        mean = float((weights[used] * heights[used]).sum())
        error = error_of_sum(
            self._error_weights(weights), self.errors.variogram, self.errors.unchanged, self.ground_step_m
        )
        # Ground that a survey did not map may have changed otherwise, by as much as the mapped part varies.
        unseen = (1.0 - share) * float(heights[used].std()) if share < 1.0 - 1e-6 else 0.0
        area = ground_area_m2(self.difference.crs, shape)
        return VolumeChange(
            name,
            area,
            share,
            mean,
            mean * area,
            float(np.hypot(error.std, unseen)) * area,
            float(np.hypot(error.half_width_95, SIGNIFICANT * unseen)) * area,
            self._naive_std_m(weights[used], used) * area,
        )

    def _known_share(self, name: str, shape: Polygon | MultiPolygon, inside: BoolArray) -> float:
        """Return the share of an outline that both surveys map; refuses less than a half."""
        on_raster = float(shape.intersection(shapely.box(*self.difference.bounds)).area / shape.area)
        share = float((inside & self.errors.known).sum()) / float(inside.sum()) * on_raster
        if share < LEAST_KNOWN_SHARE:
            raise InputError(
                f"both surveys map {share:.0%} of the outline {name!r}; {LEAST_KNOWN_SHARE:.0%} are needed for a volume."
            )
        return share

    def _error_weights(self, weights: FloatArray) -> FloatArray:
        """Return the weights of the errors of all cells in an outline's mean, less that of the unchanged ground."""
        relative, known, unchanged, _, is_levelled = self.errors
        weighted = weights * relative
        if is_levelled:
            calm = unchanged / relative**2
            weighted = weighted - calm / calm.sum() * relative
        return np.where(known, weighted, 0.0)

    def _naive_std_m(self, weights: FloatArray, used: BoolArray) -> float:
        """Return the standard deviation of the mean if the errors of all cells were independent [m]."""
        squares = (weights * self.errors.relative[used]) ** 2
        return float(np.sqrt(self.errors.variogram.variance_m2 * squares.sum()))


def ground_step_m(dem: Dem) -> float:
    """Return the mean width of a raster's cells on the ground [m]."""
    return dem.step_m / MapScale.over(dem.crs, dem.bounds).linear.mean


# Outlines that are mapped to a smaller share get a note.
_MAPPED = 0.99


def datum_notes(*datums: str) -> tuple[str, ...]:
    """Return a note where a survey states no vertical datum."""
    if all(datums):
        return ()
    return ("a survey does not state its vertical datum; check that both count from the same",)


def scale_notes(dem: Dem) -> tuple[str, ...]:
    """Return a note where lengths in the CRS differ by more than 1 % from those on the ground."""
    warning = MapScale.over(dem.crs, dem.bounds).warning
    return (warning,) if warning else ()


def coverage_notes(volumes: Iterable[VolumeChange]) -> tuple[str, ...]:
    """Return a note for each outline of which a survey does not map a part."""
    return tuple(
        f"both surveys map {one.known_share:.0%} of {printable(one.name)}; the mean change of that part is taken for all of it, "
        "and its standard deviation for the error of the rest"
        for one in volumes
        if one.known_share < _MAPPED
    )
