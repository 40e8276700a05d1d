"""How a surface changed between two surveys: difference, significance, volume and mass with honest errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.core.geodesy import same_crs, same_vertical_datum
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.base import ELEVATION, Reconstruction
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.scoring.change.coregistration import Shift, coregister
from survey.scoring.change.variogram import LARGEST_CELLS, Variogram, error_of_sum

SIGNIFICANT = 1.959964
"""A change beyond this many standard deviations is called significant."""
LEAST_KNOWN_SHARE = 0.5
"""An outline of which less than this is known in both surveys is refused."""
WATER_KG_M3 = 1000.0
# Stable ground farther from its median than this many robust deviations holds blunders, not errors.
_BLUNDER = 5.0
_NMAD = 1.4826
_N_LEAST_STABLE = 100


class MassBalance(NamedTuple):
    """Mass gained [kg], and water equivalent per area [m], each with its standard deviation."""

    mass_kg: float
    mass_std_kg: float
    specific_m_we: float
    specific_std_m_we: float


@dataclass(frozen=True)
class VolumeChange:
    """What happened within one outline.

    Parameters
    ----------
    name : str
        The outline's.
    area_m2 : float
        Its area [m²].
    known_share : float
        Share of it that both surveys know; the rest is taken to change like the known part.
    mean_m : float
        Mean change of height, positive when the surface rose [m].
    volume_m3, std_m3 : float
        Change of volume and its standard deviation [m³], with the errors' correlation.
    half_width_95_m3 : float
        Half of its 95 % interval [m³].
    naive_std_m3 : float
        What the standard deviation were if all cells erred independently; far too small.
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
        """Turn volume into mass.

        Parameters
        ----------
        density_kg_m3, density_std_kg_m3 : float
            Of what was gained or lost. 850 ± 60 kg m⁻³ is Huss's (2013, The Cryosphere 7, 877–887)
            value for glaciers over five years and more, where the firn did not change and volume did
            visibly; over shorter periods give the density measured.

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


@dataclass(frozen=True)
class Change:
    """How a surface changed.

    Parameters
    ----------
    difference : Dem
        Later minus earlier [m].
    std_m : (H, W) ndarray
        Standard deviation of each cell's difference [m].
    significant : (H, W) ndarray of int8
        1 where the surface rose beyond doubt, -1 where it sank, 0 elsewhere. One in twenty cells that
        did not change is called significant too.
    volumes : tuple of VolumeChange
        One for each outline.
    method : str
        ``joint posterior`` of two terrain models, or ``variogram`` of the unchanged ground.
    offset_m : float
        Mean difference of the unchanged ground, which was taken off [m].
    n_stable : int
        Cells of unchanged ground; 0 for the joint posterior.
    shift : Shift, optional
        What was applied to the earlier surface first.
    variogram : Variogram, optional
        Of the errors of the difference.
    notes : tuple of str
        What the figures assume.
    """

    difference: Dem
    std_m: FloatArray
    significant: Any
    volumes: tuple[VolumeChange, ...]
    method: str
    offset_m: float = 0.0
    n_stable: int = 0
    shift: Shift | None = None
    variogram: Variogram | None = None
    notes: tuple[str, ...] = ()


Outlines = Mapping[str, Polygon | MultiPolygon]
ElevationSurface = Dem | Reconstruction


def change(
    later: ElevationSurface,
    earlier: ElevationSurface,
    outlines: Outlines,
    *,
    stable: Polygon | MultiPolygon | None = None,
    align: bool = False,
    level: bool = True,
) -> Change:
    """Compare two surfaces, with errors learnt where nothing changed.

    Parameters
    ----------
    later, earlier : Dem or Reconstruction
        In one CRS and above one datum; compared at the cells of the coarser one. Where both state
        standard deviations, errors are taken to vary with them.
    outlines : mapping of str to polygon
        What may have changed, by name [m].
    stable : polygon, optional
        Ground that did not change; by default all that both know outside the outlines.
    align : bool
        First shift the earlier surface onto the later one, by their unchanged ground.
    level : bool
        Take off the mean difference of the unchanged ground; its own error is counted.

    Raises
    ------
    InputError
        Mixed systems or datums, fewer than 100 cells of unchanged ground, an outline less than half of
        which is known, or rasters beyond 16 million cells (cut or average them first).

    Notes
    -----
    Errors on the outlines are taken to be like those on the unchanged ground: snow without contrast
    and penetration of radar are not. An error that goes together over more than half the ground is
    not seen.

    Examples
    --------
    >>> rng = np.random.default_rng(3)
    >>> grid = Grid((0.0, 0.0, 390.0, 390.0), 10.0)
    >>> before = Dem.on(grid, rng.normal(0.0, 0.2, grid.shape))
    >>> after = Dem.on(grid, np.where(np.hypot(grid.x - 200, grid.y[:, None] - 200) < 100.0, -3.0, 0.0))
    >>> found = change(after, before, {"ice": shapely.Point(200.0, 200.0).buffer(100.0)}).volumes[0]
    >>> bool(abs(found.mean_m + 3.0) < 0.05), bool(found.naive_std_m3 > 0.0)
    (True, True)
    """
    new, old = _dem(later), _dem(earlier)
    same_crs(new.crs, old.crs, "the two surveys")
    same_vertical_datum(new.vertical_datum, old.vertical_datum, "the two surveys")
    grid = (new if new.step_m >= old.step_m else old).grid()
    if np.prod(grid.shape) > LARGEST_CELLS:
        raise InputError(
            f"the surveys have {np.prod(grid.shape):,} cells; change is computed for {LARGEST_CELLS:,} at most, cut or average them first."
        )
    ground = _Ground.of(grid, outlines, stable)
    shift = coregister(old, new, _on(new, ground)) if align else None
    heights = new.at(grid.xy), old.at(grid.xy) if shift is None else shift.applied(grid.xy, old)
    difference = (heights[0] - heights[1]).reshape(grid.shape)
    scale = _claimed(later, earlier, grid)
    return _judged(grid, difference, scale, ground, level=level, shift=shift, datum=new.vertical_datum)


def change_of_models(
    later: GaussianProcessTerrain, earlier: GaussianProcessTerrain, outlines: Outlines, grid: Grid
) -> Change:
    """Compare two fitted terrain models, with errors from their joint posteriors.

    Parameters
    ----------
    later, earlier : GaussianProcessTerrain
        Of the elevation, in one CRS, above one datum.
    outlines : mapping of str to polygon
        Where volumes are wanted [m]; within both sites.
    grid : Grid
        On which the difference is mapped; its step is that of the volumes too.

    Raises
    ------
    InputError
        Other quantities, mixed datums, an outline outside a site.

    Notes
    -----
    The surveys' errors are taken to be independent: a prior surface that both share counts twice, and a
    drift of the positions that is not in the points' covariances is not seen.
    """
    if {later.quantity, earlier.quantity} != {ELEVATION}:
        raise InputError(
            f"the models map {later.quantity} and {earlier.quantity}; change is computed of {ELEVATION}."
        )
    same_vertical_datum(later.vertical_datum_, earlier.vertical_datum_, "the two surveys")
    new, old = later.grid(grid), earlier.grid(grid)
    difference = new.mean.elevation - old.mean.elevation
    std = np.hypot(new.std.elevation, old.std.elevation)
    volumes = []
    for name, polygon in outlines.items():
        # One base near the surface keeps the sums small.
        base = float(np.nanmean(old.mean.elevation))
        found = later.volume(polygon, base_m=base, step_m=grid.step_m).minus(
            earlier.volume(polygon, base_m=base, step_m=grid.step_m)
        )
        inside = shapely.contains_xy(polygon, *grid.xy.T).reshape(grid.shape)
        volumes.append(
            VolumeChange(
                name,
                found.area_m2,
                1.0,
                found.mean_m3 / found.area_m2,
                found.mean_m3,
                found.std_m3,
                SIGNIFICANT * found.std_m3,
                float(np.sqrt((std[inside] ** 2).sum())) * grid.step_m**2,
            )
        )
    return Change(
        Dem.on(grid, difference, later.vertical_datum_),
        std,
        _significant(difference, std),
        tuple(volumes),
        "joint posterior",
        notes=_datum_note(later.vertical_datum_, earlier.vertical_datum_),
    )


class _Ground(NamedTuple):
    """Which cells may have changed, by outline, and which did not."""

    grid: Grid
    outlines: Outlines
    inside: tuple[BoolArray, ...]
    stable: BoolArray

    @classmethod
    def of(cls, grid: Grid, outlines: Outlines, stable: Polygon | MultiPolygon | None) -> "_Ground":
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


def _judged(
    grid: Grid,
    difference: FloatArray,
    scale: FloatArray,
    ground: _Ground,
    *,
    level: bool,
    shift: Shift | None,
    datum: str,
) -> Change:
    """Learn the errors of the unchanged ground, and carry them to the outlines."""
    known = np.isfinite(difference) & np.isfinite(scale)
    calm = _without_blunders(difference / scale, known & ground.stable)
    offset = _mean(difference, 1.0 / scale**2, calm) if level else 0.0
    levelled = difference - offset
    variogram = Variogram.of(np.where(calm, levelled / scale, 0.0), calm, grid.step_m)
    std = np.where(known, np.sqrt(variogram.variance_m2) * scale, np.nan)
    compared = Dem.on(grid, levelled, datum)
    carry = _Carry(levelled, scale, known, calm, variogram, level, compared.bounds)
    volumes = tuple(
        carry.volume(name, shape, mask, grid.step_m)
        for (name, shape), mask in zip(ground.outlines.items(), ground.inside, strict=True)
    )
    return Change(
        compared,
        std,
        _significant(levelled, std),
        volumes,
        "variogram",
        offset,
        int(calm.sum()),
        shift,
        variogram,
        _notes(datum, level=level, n_blunders=int((known & ground.stable).sum() - calm.sum())),
    )


class _Carry(NamedTuple):
    """What is needed to sum a difference over an outline with its error."""

    difference: FloatArray
    scale: FloatArray
    known: BoolArray
    calm: BoolArray
    variogram: Variogram
    level: bool
    bounds: tuple[float, float, float, float]

    def volume(
        self, name: str, shape: Polygon | MultiPolygon, inside: BoolArray, step_m: float
    ) -> VolumeChange:
        used = inside & self.known
        on_raster = float(shape.intersection(shapely.box(*self.bounds)).area) / shape.area
        share = float(used.sum()) / float(inside.sum()) * on_raster
        if share < LEAST_KNOWN_SHARE:
            raise InputError(
                f"both surveys know {share:.0%} of the outline {name!r}; {LEAST_KNOWN_SHARE:.0%} are needed for a volume."
            )
        mean = float(self.difference[used].mean())
        weights = used / used.sum() * self.scale
        if self.level:
            calm = self.calm / self.scale**2
            weights = weights - calm / calm.sum() * self.scale
        weights = np.where(self.known, weights, 0.0)
        error = error_of_sum(weights, self.variogram, self.calm, step_m)
        # What no survey saw may have changed otherwise, by as much as the known part varies.
        unseen = (1.0 - share) * float(self.difference[used].std()) if share < 1.0 - 1e-6 else 0.0
        std = float(np.hypot(error.std, unseen))
        half = float(np.hypot(error.half_width_95, SIGNIFICANT * unseen))
        cells = np.sqrt(self.variogram.variance_m2 * (self.scale[used] ** 2).sum()) / used.sum()
        area = float(shape.area)
        return VolumeChange(
            name, area, share, mean, mean * area, std * area, half * area, float(cells) * area
        )


def _dem(surface: ElevationSurface) -> Dem:
    if isinstance(surface, Dem):
        return surface
    if surface.quantity != ELEVATION:
        raise InputError(f"a survey maps {surface.quantity}; change is computed of {ELEVATION}.")
    return surface.mean


def _claimed(later: ElevationSurface, earlier: ElevationSurface, grid: Grid) -> FloatArray:
    """Return the difference's stated deviations relative to their mean; 1 where a survey states none."""
    if isinstance(later, Dem) or isinstance(earlier, Dem):
        return np.ones(grid.shape)
    std = np.hypot(later.std.at(grid.xy), earlier.std.at(grid.xy)).reshape(grid.shape)
    if not (std[np.isfinite(std)] > 0.0).all():
        raise InputError("a survey states standard deviations of 0; every survey errs, correct them.")
    scale: FloatArray = std / np.nanmean(std)
    return scale


def _on(dem: Dem, ground: _Ground) -> BoolArray:
    """Return the stable ground on the cells of a raster."""
    stable = Dem.on(ground.grid, ground.stable.astype(np.float64))
    calm: BoolArray = (stable.at(dem.xy) > 0.99).reshape(dem.shape)
    return calm


def _without_blunders(difference: FloatArray, stable: BoolArray) -> BoolArray:
    if stable.sum() < _N_LEAST_STABLE:
        raise InputError(
            f"both surveys know {int(stable.sum())} cells of unchanged ground; {_N_LEAST_STABLE} are needed to learn their errors, "
            "survey some ground around the outline, or compare two terrain models (.npz)."
        )
    e = difference[stable]
    spread = max(float(_NMAD * np.median(np.abs(e - np.median(e)))), 1e-9)
    calm: BoolArray = stable & (np.abs(np.where(stable, difference, 0.0) - np.median(e)) <= _BLUNDER * spread)
    return calm


def _mean(values: FloatArray, weights: FloatArray, mask: BoolArray) -> float:
    return float((values[mask] * weights[mask]).sum() / weights[mask].sum())


def _significant(difference: FloatArray, std: FloatArray) -> Any:
    beyond = np.abs(difference) > SIGNIFICANT * std
    return np.where(beyond, np.sign(np.nan_to_num(difference)), 0.0).astype(np.int8)


def _notes(datum: str, *, level: bool, n_blunders: int) -> tuple[str, ...]:
    notes = list(_datum_note(datum, datum))
    if n_blunders:
        notes.append(
            f"{n_blunders} cells of unchanged ground beyond {_BLUNDER:g} robust deviations were not learnt from"
        )
    if not level:
        notes.append("an offset that all cells share is neither taken off nor in the standard deviation")
    return tuple(notes)


def _datum_note(*datums: str) -> tuple[str, ...]:
    if all(datums):
        return ()
    return ("a survey does not state its vertical datum; check that both count from the same",)
