"""Elevation change between two surveys: difference, significance, volume and mass with errors.

`change` subtracts two surfaces on the grid of the coarser one, after an alignment where asked for, and
estimates the errors from the variogram of the difference on unchanged ground. `change_of_models` subtracts two
fitted terrain models and takes the errors from their joint posteriors; it needs no unchanged ground. Both
integrate the difference over outlines.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core import (
    BoolArray,
    FloatArray,
    InputError,
    check_types,
    printable,
    same_crs,
    same_vertical_datum,
)
from survey.core.map_scale import areal_factors
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction
from survey.scoring.differencing.along_flow import Thickness, change_along_flow
from survey.scoring.differencing.coregistration import SurveyAlignment
from survey.scoring.differencing.coregistration import align as align_surface
from survey.scoring.differencing.displacements import DisplacementField
from survey.scoring.differencing.variogram import LARGEST_CELLS, Variogram
from survey.scoring.differencing.volume_change import (
    BLUNDER,
    LEAST_KNOWN_SHARE,
    SIGNIFICANT,
    Change,
    ChangeErrors,
    ComparedGround,
    Corrections,
    Outlines,
    OutlineVolumes,
    StableLevel,
    VolumeChange,
    coverage_notes,
    datum_notes,
    ground_step_m,
    remove_blunders,
    scale_notes,
    significance,
)

if TYPE_CHECKING:
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain

ElevationSurface = Dem | Reconstruction
# Independent surveys agree to the last digit on few cells only.
_MOST_EQUAL = 0.5
# Geoids and ellipsoids, or feet and metres, differ by more.
_LARGEST_OFFSET_M = 10.0


@check_types
def change(
    later: ElevationSurface,
    earlier: ElevationSurface,
    outlines: Outlines | None = None,
    *,
    stable: Polygon | MultiPolygon | None = None,
    align: bool = False,
    level: bool = True,
    flow: DisplacementField | None = None,
    thickness: Thickness | None = None,
) -> Change:
    """Compute the elevation change between two surfaces, with errors estimated on unchanged ground.

    Parameters
    ----------
    later, earlier : Dem or Reconstruction
        In one CRS and above one datum; compared at the cells of the coarser one. Where both state
        standard deviations, the errors are assumed to vary with them.
    outlines : mapping of str to polygon, optional
        Ground that may have changed, by name, in the surveys' CRS [m]. Of several, those beyond the surveys, and those of
        which both map less than half, are left out with a note.
    stable : polygon, optional
        Ground that did not change; by default all that both surveys map outside the outlines.
    align : bool
        First correct shift, tilt and bias by curvature of the earlier surface, by the unchanged ground (`SurveyAlignment`);
        their errors are counted.
    level : bool
        Subtract the median difference of the unchanged ground; its own error is counted.
    flow : DisplacementField, optional
        Displacement of the ice between the surveys, of a type in `survey.scoring.differencing.displacements`: adds the change along
        the flow and the divergence of the flux.
    thickness : Thickness, optional
        Of the ice, for that divergence; from the slope of the surface, within a factor of two, where left out.

    Returns
    -------
    Change
        Areas, volumes and correlation lengths count on the ground: the areal scale factor of the CRS is
        applied cell by cell. The raster of the difference stays in the CRS.

    Raises
    ------
    InputError
        Mixed systems or datums, fewer than 100 cells of unchanged ground, no outline of which both map
        a half, or rasters beyond 16 million cells (cut or average them first).

    Notes
    -----
    Errors on the outlines are assumed to be like those on the unchanged ground: errors from snow without
    contrast and from radar penetration are not included. An error that is correlated over more than half
    the unchanged ground cannot be seen. Without outlines and unchanged ground, all common ground counts as unchanged.

    Examples
    --------
    >>> import shapely
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
    grid = _common_grid(new, old)
    outlines = {} if outlines is None else outlines
    ground = ComparedGround.of(grid, outlines, stable)
    relative = _relative_std(later, earlier, grid)
    reference = Dem.on(grid, new.at(grid.xy).reshape(grid.shape), new.vertical_datum)
    compared = _Compared.of(reference, old, relative, ground, is_aligned=align, is_levelled=level)
    notes = _stable_notes(has_ground=bool(outlines) or stable is not None, uses_it=align or level)
    found = _change(compared, relative, ground)
    datums = datum_notes(new.vertical_datum, old.vertical_datum)
    found = replace(found, notes=(*datums, *found.notes, *notes))
    if flow is None:
        return found
    followed = {one.name: outlines[one.name] for one in found.volumes}
    return replace(found, along_flow=change_along_flow(found, new, followed, flow, thickness))


class _Compared(NamedTuple):
    """Difference of two surfaces; heights of the ground (H, W); what was corrected, and how that changes the difference (K, H, W)."""

    difference: Dem
    heights: FloatArray
    design: FloatArray
    is_levelled: bool
    alignment: SurveyAlignment | None = None
    terms: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        reference: Dem,
        old: Dem,
        relative: FloatArray,
        ground: ComparedGround,
        *,
        is_aligned: bool,
        is_levelled: bool,
    ) -> "_Compared":
        """Subtract a surface from a reference, aligned where asked for."""
        grid = ground.grid
        before = old.at(grid.xy).reshape(grid.shape)
        heights = np.where(np.isfinite(before), before, reference.elevation)
        design = np.ones((int(is_levelled), *grid.shape))
        if not is_aligned:
            difference = Dem.on(grid, reference.elevation - before, reference.vertical_datum)
            return cls(difference, heights, design, is_levelled)
        made = align_surface(old, reference, ground.stable, np.nan_to_num(relative**-2.0))
        difference = Dem.on(grid, reference.elevation - made.heights, reference.vertical_datum)
        return cls(difference, heights, made.columns, is_levelled, made.alignment, made.terms)


def _change(compared: _Compared, relative: FloatArray, ground: ComparedGround) -> Change:
    """Estimate the errors on the unchanged ground, and integrate over the outlines."""
    heights = compared.difference.elevation
    known = np.isfinite(heights) & np.isfinite(relative)
    unchanged = remove_blunders(heights / relative, known & ground.stable)
    median = _weighted_median(heights[known & ground.stable], 1.0 / relative[known & ground.stable])
    offset = median if compared.is_levelled else 0.0
    levelled = Dem.on(ground.grid, heights - offset, compared.difference.vertical_datum)
    scaled = np.where(unchanged, levelled.elevation / relative, 0.0)
    variogram = Variogram.of(scaled, unchanged, ground_step_m(levelled))
    std = np.where(known, np.sqrt(variogram.variance_m2) * relative, np.nan)
    errors = ChangeErrors(relative, known, unchanged, variogram, compared.design, compared.is_levelled)
    corrections = Corrections(errors, ground_step_m(levelled))
    volumes = OutlineVolumes(levelled, compared.heights, corrections, ground)
    changes, left_out = _over_outlines(volumes, ground)
    alignment = compared.alignment
    if alignment is not None:
        alignment = replace(alignment, std=dict(zip(compared.terms, corrections.stds(), strict=True)))
    level = None
    if compared.is_levelled:
        level = StableLevel(median, _mean(heights, relative**-2.0, unchanged), corrections.median_excess_m)
    return Change(
        levelled,
        std,
        significance(levelled.elevation, std),
        tuple(found for found, _ in changes),
        "variogram",
        offset,
        int(unchanged.sum()),
        alignment,
        variogram,
        (
            *_copy_notes(heights[known & ground.stable]),
            *_offset_notes(offset),
            *_level_notes(level),
            *_alignment_notes(alignment),
            *_error_notes(
                int((known & ground.stable).sum() - unchanged.sum()), has_offset=not len(compared.design)
            ),
            *scale_notes(levelled),
            *coverage_notes(found for found, _ in changes),
            *left_out,
        ),
        level=level,
        total=volumes.together(changes),
    )


def _over_outlines(
    volumes: OutlineVolumes, ground: ComparedGround
) -> tuple[list[tuple[VolumeChange, BoolArray]], tuple[str, ...]]:
    """Return the change over each outline with its cells (H, W), and notes on those of several that cannot be integrated over."""
    found, refused = [], []
    for (name, shape), inside in zip(ground.outlines.items(), ground.inside, strict=True):
        try:
            found.append((volumes.over(name, shape, inside), inside))
        except InputError as error:
            refused.append((name, error))
    if refused and not found:
        raise refused[0][1]
    if not refused:
        return found, ()
    names = ", ".join(printable(name) for name, _ in refused)
    note = (
        f"{len(refused)} of {len(ground.outlines)} outlines are left out, because both surveys map less than "
        f"{LEAST_KNOWN_SHARE:.0%} of each: {names}"
    )
    return found, (note,)


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Return the median of values (N,); half the sum of the weights (N,) lies on each side."""
    if np.ptp(weights) == 0.0:
        return float(np.median(values))
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, 0.5 * below[-1])])


def _common_grid(new: Dem, old: Dem) -> Grid:
    """Return the grid of the coarser survey; refuses one that is too large."""
    grid = (new if new.step_m >= old.step_m else old).grid()
    if np.prod(grid.shape) > LARGEST_CELLS:
        raise InputError(
            f"the surveys have {np.prod(grid.shape):,} cells; change is computed for {LARGEST_CELLS:,} at most, cut or average them first."
        )
    return grid


def _dem(surface: ElevationSurface) -> Dem:
    if isinstance(surface, Dem):
        return surface
    if surface.quantity != ELEVATION:
        raise InputError(f"a survey maps {surface.quantity}; change is computed of {ELEVATION}.")
    return surface.mean


def _relative_std(later: ElevationSurface, earlier: ElevationSurface, grid: Grid) -> FloatArray:
    """Return the stated deviations of the difference relative to their mean; 1 where a survey states none."""
    if isinstance(later, Dem) or isinstance(earlier, Dem):
        return np.ones(grid.shape)
    std = np.hypot(later.std.at(grid.xy), earlier.std.at(grid.xy)).reshape(grid.shape)
    if not (std[np.isfinite(std)] > 0.0).all():
        raise InputError("a survey states standard deviations of 0; every survey errs, correct them.")
    relative: FloatArray = std / np.nanmean(std)
    return relative


def _copy_notes(stable_m: FloatArray) -> tuple[str, ...]:
    """Return a note where the difference is exactly 0 on most of the unchanged ground: no error can be seen there."""
    share = float(np.mean(stable_m == 0.0)) if stable_m.size else 0.0
    if share <= _MOST_EQUAL:
        return ()
    return (
        f"{share:.0%} of the unchanged ground has the same height in both surveys to the last digit, as where one was filled "
        "from the other: their errors cannot be seen there, and the interval is too narrow; name ground that both "
        "surveyed (--stable)",
    )


def _mean(values: FloatArray, weights: FloatArray, mask: BoolArray) -> float:
    return float((values[mask] * weights[mask]).sum() / weights[mask].sum())


def _offset_notes(offset_m: float) -> tuple[str, ...]:
    """Return a note where more was subtracted than surveys err by."""
    if abs(offset_m) <= _LARGEST_OFFSET_M:
        return ()
    return (
        f"{offset_m:+.4g} m, the median difference of the unchanged ground, were subtracted, which is more than surveys err by; "
        "check the units and the vertical datums of both",
    )


def _level_notes(level: StableLevel | None) -> tuple[str, ...]:
    """Return a note where median and mean of the unchanged ground differ by more than their errors."""
    if level is None or not level.disagrees:
        return ()
    return (
        f"the median of the unchanged ground, {level.median_m:+.3f} m, was subtracted; its mean is {level.mean_m:+.3f} m, which is "
        f"farther off than their errors allow ({SIGNIFICANT * level.excess_m:.3f} m): some of that ground changed, or its errors are skewed",
    )


def _stable_notes(*, has_ground: bool, uses_it: bool) -> tuple[str, ...]:
    """Return a note where no ground is stated to be unchanged."""
    if has_ground:
        return ()
    used = "levelled and aligned by it" if uses_it else "neither levelled nor aligned by it"
    return (
        f"no unchanged ground is stated: all common ground without blunders is taken for it, and the surveys are {used}, which is "
        "right where most of it did not change; state it by --stable, or what changed by --outline",
    )


def _alignment_notes(alignment: SurveyAlignment | None) -> tuple[str, ...]:
    """Return a note on terms of an alignment that the unchanged ground does not determine."""
    if alignment is None or not alignment.left_out:
        return ()
    words = {
        "east_m": "shift to the east",
        "north_m": "shift to the north",
        "curvature_bias_m2": "bias by curvature",
    }
    names = ", ".join(words[name] for name in alignment.left_out)
    return (f"the unchanged ground is too even to determine: {names}; not corrected",)


def _error_notes(n_blunders: int, *, has_offset: bool) -> tuple[str, ...]:
    """Return notes on blunders that were left out and on an offset that stays in."""
    notes = []
    if n_blunders:
        notes.append(
            f"{n_blunders} cells of unchanged ground beyond {BLUNDER:g} robust deviations were left out of the error estimate"
        )
    if has_offset:
        notes.append("an offset common to all cells is neither subtracted nor in the standard deviation")
    return tuple(notes)


def change_of_models(
    later: "GaussianProcessTerrain",
    earlier: "GaussianProcessTerrain",
    outlines: Mapping[str, Polygon | MultiPolygon],
    grid: Grid,
) -> Change:
    """Compute the change between two fitted terrain models, with errors from their posteriors.

    `outlines`: polygons to integrate over [m]; within both sites. Returns: with the method ``joint
    posterior``.

    The surveys' errors are assumed to be independent: those of a prior surface that both share count twice,
    and drift of the positions that is not in the points' covariances is not included.
    """
    if {later.quantity, earlier.quantity} != {ELEVATION}:
        raise InputError(
            f"the models map {later.quantity} and {earlier.quantity}; change is computed of {ELEVATION}."
        )
    same_vertical_datum(later.vertical_datum_, earlier.vertical_datum_, "the two surveys")
    new, old = later.grid(grid), earlier.grid(grid)
    difference = new.mean.elevation - old.mean.elevation
    std = np.hypot(new.std.elevation, old.std.elevation)
    volumes = tuple(
        _volume(later, earlier, name, polygon, grid, base_m=float(np.nanmean(old.mean.elevation)), std_m=std)
        for name, polygon in outlines.items()
    )
    compared = Dem.on(grid, difference, later.vertical_datum_)
    notes = (*datum_notes(later.vertical_datum_, earlier.vertical_datum_), *scale_notes(compared))
    return Change(compared, std, significance(difference, std), volumes, "joint posterior", notes=notes)


def _volume(
    later: "GaussianProcessTerrain",
    earlier: "GaussianProcessTerrain",
    name: str,
    polygon: Polygon | MultiPolygon,
    grid: Grid,
    *,
    base_m: float,
    std_m: FloatArray,
) -> VolumeChange:
    """Integrate both posteriors over an outline; a base near the surface keeps the sums small."""
    new, old = (
        model.volume(polygon, base_m=base_m, step_m=grid.step_m, crs=grid.crs) for model in (later, earlier)
    )
    found = new.minus(old)
    inside = shapely.contains_xy(polygon, *grid.xy.T).reshape(grid.shape)
    cells_m2 = grid.step_m**2 / areal_factors(grid.crs, grid.x, grid.y)[inside]
    naive_std_m3 = float(np.sqrt(((std_m[inside] * cells_m2) ** 2).sum()))
    return VolumeChange(
        name,
        found.area_m2,
        1.0,
        found.mean_m3 / found.area_m2,
        found.mean_m3,
        found.std_m3,
        SIGNIFICANT * found.std_m3,
        naive_std_m3,
    )
