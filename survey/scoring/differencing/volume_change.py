"""Elevation and volume change over outlines, with errors carried over from unchanged ground, and its files.

`Change` is the result of a comparison: difference, standard deviation, significance, and a `VolumeChange` for
each outline, from which mass follows by a density. `ComparedGround` rasterizes the outlines and the ground that
did not change. `OutlineVolumes` integrates a difference over outlines; the error of a mean follows from the
variogram. The notes state assumptions that a reader has to check. Named outlines of glaciers come from GeoJSON,
GeoPackage, KML, KMZ or Shapefile; surveys that are too large for the memory are averaged over squares of cells. A change
is written as rasters, as a table for spreadsheets, and as JSON.
"""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon, Polygon

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    agreed_crs,
    printable,
    projected_crs,
    write_json,
    write_text,
)
from survey.core.map_scale import MapScale, areal_factors, ground_area_m2
from survey.core.text import csv_cell
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.outlines import (
    check_polygon,
    in_crs,
    polygon_parts,
    read_outlines_file,
    refuse_nested,
    with_simple_rings,
)
from survey.io.raster import raster_header, sigma_band, write_raster
from survey.io.raster.large import read_averaged
from survey.reconstruction.terrain_map import INTERPOLATED, Reconstruction
from survey.scoring.accuracy import NMAD_FACTOR
from survey.scoring.differencing.coregistration import Shift
from survey.scoring.differencing.variogram import LARGEST_CELLS, Variogram, error_of_sum

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


def read_outlines(
    path: str | Path, crs: Any, select: Sequence[str] = ()
) -> dict[str, Polygon | MultiPolygon]:
    """Read polygons by name from GeoJSON, GeoPackage, KML, KMZ or Shapefile into a projected CRS.

    `select`: which of them; a name, or ``COLUMN=VALUE``, with ``*`` for any letters.
    """
    what = "the outline file"
    found = read_outlines_file(path, what, select=select, has_roles=False)
    features = with_simple_rings(found.features)
    refuse_nested(features, only_parts=True)
    wheres = [f"{found.where}: the outline {printable(name)!r}" for name in found.names]
    for where, shape in zip(wheres, features.geometry, strict=True):
        polygon_parts(shape, where)
    shapes = shapely.force_2d(in_crs(features, projected_crs(crs, "the surveys"), found.where).geometry)
    for where, shape in zip(wheres, shapes, strict=True):
        check_polygon(shape, where)
    return dict(zip(found.names, shapes, strict=True))


_AVERAGED_CELLS = 4_000_000


def averaged_step_m(files: list[Path]) -> float | None:
    """Return the side of the squares over which surveys are averaged before they are compared [m].

    Returns: None where every survey is small enough to be compared cell by cell.
    """
    headers = [raster_header(file) for file in files]
    if all(math.prod(header.shape) <= LARGEST_CELLS for header in headers):
        return None
    sides = [math.prod(header.shape) * header.transform.a**2 / _AVERAGED_CELLS for header in headers]
    return float(max(np.sqrt(sides).max(), *(header.transform.a for header in headers)))


def average_survey(
    file: Path, step_m: float, crs: Any = None, units: str | None = None
) -> Reconstruction | Dem:
    """Return a survey averaged over squares of about a given side, with its band of standard deviations (`sigma_band`).

    `step_m`: side of the squares [m]; whole cells are taken, at least one.
    """
    cells = max(1, math.ceil(step_m / raster_header(file).transform.a - 1e-9))
    bands = (1,) if sigma_band(file) is None else (1, 2)
    rasters = read_averaged(file, cells, bands, units)
    system = agreed_crs(rasters[0].crs, crs, str(file))
    mean, *std = (Dem(one.values, one.transform, system, one.vertical_datum) for one in rasters)
    if not std:
        return mean
    return Reconstruction(mean, std[0], np.full(mean.shape, INTERPOLATED), "outside", {})


TABLE_COLUMNS = (
    "name", "area_m2", "known_share", "mean_change_m", "volume_change_m3", "volume_std_m3",
    "volume_low_95_m3", "volume_high_95_m3", "naive_std_m3", "mass_change_kg", "mass_std_kg",
    "specific_mass_balance_m_we", "specific_std_m_we",
)  # fmt: skip


def change_rows(
    change: Change, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0
) -> list[dict[str, Any]]:
    """Return one row for each outline, units in the keys."""
    rows = []
    for found in change.volumes:
        mass = found.mass(density_kg_m3, density_std_kg_m3)
        low, high = (found.volume_m3 + sign * found.half_width_95_m3 for sign in (-1.0, 1.0))
        values = (found.name, found.area_m2, found.known_share, found.mean_m, found.volume_m3, found.std_m3)
        row = (*values, low, high, found.naive_std_m3, *mass)
        rows.append(dict(zip(TABLE_COLUMNS, row, strict=True)))
    return rows


def change_facts(
    change: Change, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0
) -> dict[str, Any]:
    """Return everything but the rasters, as JSON has it."""
    facts = {
        "volumes": change_rows(change, density_kg_m3, density_std_kg_m3),
        "density_kg_m3": density_kg_m3,
        "density_std_kg_m3": density_std_kg_m3,
        "method": change.method,
        "offset_m": change.offset_m,
        "n_stable": change.n_stable,
        "shift": None if change.shift is None else asdict(change.shift),
        "variogram": None if change.variogram is None else asdict(change.variogram),
        "significant_share": float(np.mean(np.asarray(change.significant) != 0)),
        "map_scale": change.map_scale.to_dict(),
        "notes": list(change.notes),
    }
    if change.along_flow is not None:
        facts["along_flow"] = [balance._asdict() for balance in change.along_flow.balances]
    return facts


def write_change(
    folder: str | Path, change: Change, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0
) -> None:
    """Write ``change.tif`` (difference, deviation, significance), ``change.csv`` and ``change.json``.

    With a flow also ``along_flow.tif``: difference along the flow and displacement, with their deviations.
    """
    place, dem = Path(folder), change.difference
    bands = {
        "difference": dem.elevation,
        "standard_deviation": change.std_m,
        "significant": np.asarray(change.significant, dtype=np.float64),
    }
    write_raster(place / "change.tif", bands, dem.transform, dem.crs, dem.vertical_datum)
    if change.along_flow is not None:
        _write_along_flow(place / "along_flow.tif", change.along_flow)
    facts = change_facts(change, density_kg_m3, density_std_kg_m3)
    text = io.StringIO()
    table = csv.DictWriter(text, TABLE_COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows({**row, "name": csv_cell(row["name"])} for row in facts["volumes"])
    write_text(place / "change.csv", text.getvalue())
    write_json(place / "change.json", facts)


def _write_along_flow(path: Path, found: AlongFlow) -> None:
    bands = {"difference_along_flow": found.difference.elevation, "standard_deviation": found.std_m}
    for name, values in (("displacement", found.shift_m), ("displacement_std", found.shift_std_m)):
        bands |= {f"{name}_east": values[0], f"{name}_north": values[1]}
    write_raster(
        path, bands, found.difference.transform, found.difference.crs, found.difference.vertical_datum
    )
