"""Files of a change: outlines and large surveys are read, rasters, tables and JSON are written.

Named outlines of glaciers come from GeoJSON, GeoPackage, KML, KMZ or Shapefile; surveys that are too large for the memory
are averaged over squares of cells. A change is written as rasters, as tables for spreadsheets, as polygons, and as JSON.
"""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core import agreed_crs, printable, projected_crs, write_json, write_text
from survey.core.text import csv_cell
from survey.data.dem import Dem
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
from survey.io.vector import write_features
from survey.reconstruction.terrain_map import INTERPOLATED, Reconstruction
from survey.scoring.differencing.variogram import LARGEST_CELLS
from survey.scoring.differencing.volume_change import AlongFlow, Change, VolumeChange


def read_outlines(
    path: str | Path, crs: Any, select: Sequence[str] = ()
) -> dict[str, Polygon | MultiPolygon]:
    """Read polygons by name from GeoJSON, GeoPackage, KML, KMZ or Shapefile into a projected CRS.

    `select`: which of them; a name, or ``COLUMN=VALUE``, with ``*`` for any letters.
    """
    return read_glaciers(path, crs, select).shapes


class Glaciers(NamedTuple):
    """Polygons by name in a projected CRS, and their identifiers in an inventory by the same names; "" where it has none."""

    shapes: dict[str, Polygon | MultiPolygon]
    identifiers: dict[str, str]


def read_glaciers(path: str | Path, crs: Any, select: Sequence[str] = ()) -> Glaciers:
    """Read polygons as `read_outlines` does, with their identifiers in an inventory of glaciers (RGI, GLIMS)."""
    found = read_outlines_file(path, "the outline file", select=select, has_roles=False)
    features = with_simple_rings(found.features)
    refuse_nested(features, only_parts=True)
    wheres = [f"{found.where}: the outline {printable(name)!r}" for name in found.names]
    for where, shape in zip(wheres, features.geometry, strict=True):
        polygon_parts(shape, where)
    shapes = shapely.force_2d(in_crs(features, projected_crs(crs, "the surveys"), found.where).geometry)
    for where, shape in zip(wheres, shapes, strict=True):
        check_polygon(shape, where)
    names = found.names
    return Glaciers(dict(zip(names, shapes, strict=True)), dict(zip(names, found.identifiers, strict=True)))


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
    "name", "id", "area_m2", "known_share", "mean_change_m", "volume_change_m3", "volume_std_m3",
    "volume_low_95_m3", "volume_high_95_m3", "void_std_m3", "naive_std_m3", "density_kg_m3",
    "density_std_kg_m3", "mass_change_kg", "mass_std_kg", "specific_mass_balance_m_we", "specific_std_m_we",
)  # fmt: skip
BAND_COLUMNS = ("name", "id", "low_m", "high_m", "area_m2", "known_share", "mean_change_m", "spread_m")
_STATISTICS = ("n", "median_m", "nmad_m", "std_m", "rmse_m", "p95_m", "worst_m")


def change_rows(
    change: Change, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0
) -> list[dict[str, Any]]:
    """Return one row for each outline, units in the keys."""
    return [_row(found, density_kg_m3, density_std_kg_m3) for found in change.volumes]


def _row(found: VolumeChange, *density_kg_m3: float) -> dict[str, Any]:
    low, high = (found.volume_m3 + sign * found.half_width_95_m3 for sign in (-1.0, 1.0))
    place = found.name, found.identifier, found.area_m2, found.known_share
    volume = found.mean_m, found.volume_m3, found.std_m3, low, high, found.void_std_m3, found.naive_std_m3
    row = (*place, *volume, *density_kg_m3, *found.mass(*density_kg_m3))
    return dict(zip(TABLE_COLUMNS, row, strict=True))


def change_facts(
    change: Change, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0
) -> dict[str, Any]:
    """Return everything but the rasters, as JSON has it."""
    statistics = change.statistics
    facts = {
        "difference": {
            "mean_m": statistics.bias_m,
            **{name: getattr(statistics, name) for name in _STATISTICS},
        },
        "volumes": change_rows(change, density_kg_m3, density_std_kg_m3),
        "total": None if change.total is None else _row(change.total, density_kg_m3, density_std_kg_m3),
        "density_kg_m3": density_kg_m3,
        "density_std_kg_m3": density_std_kg_m3,
        "method": change.method,
        "offset_m": change.offset_m,
        "n_stable": change.n_stable,
        "level": None if change.level is None else change.level._asdict(),
        "alignment": None if change.alignment is None else asdict(change.alignment),
        "variogram": None if change.variogram is None else asdict(change.variogram),
        "significant_share": float(np.mean(np.asarray(change.significant) != 0)),
        "map_scale": change.map_scale.to_dict(),
        "notes": list(change.notes),
    }
    if change.along_flow is not None:
        facts["along_flow"] = [balance._asdict() for balance in change.along_flow.balances]
    return facts


def write_change(
    folder: str | Path,
    change: Change,
    density_kg_m3: float = 850.0,
    density_std_kg_m3: float = 60.0,
    *,
    outlines: Mapping[str, Polygon | MultiPolygon] | None = None,
) -> None:
    """Write ``change.tif`` (difference, deviation, significance) and ``change.json``.

    With outlines also ``change.csv`` and ``change.gpkg``, a row for each, and ``change_bands.csv``, a row for each elevation
    band of each. With a flow also ``along_flow.tif``: difference along the flow and displacement, with their deviations.
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
    write_json(place / "change.json", facts)
    if change.volumes:
        _write_table(place / "change.csv", TABLE_COLUMNS, facts["volumes"])
        rows = [(one.name, one.identifier, *band) for one in change.volumes for band in one.bands]
        _write_table(
            place / "change_bands.csv",
            BAND_COLUMNS,
            [dict(zip(BAND_COLUMNS, row, strict=True)) for row in rows],
        )
    if outlines:
        shapes = [outlines[one.name] for one in change.volumes]
        columns = {
            name: np.array(
                [row[name] for row in facts["volumes"]],
                dtype=object if name in ("name", "id") else np.float64,
            )
            for name in TABLE_COLUMNS
        }
        write_features(place / "change.gpkg", shapes, columns, dem.crs, layer="change")


def _write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as CSV; names are escaped for spreadsheets."""
    text = io.StringIO()
    table = csv.DictWriter(text, columns, lineterminator="\n")
    table.writeheader()
    table.writerows({**row, "name": csv_cell(row["name"]), "id": csv_cell(row["id"])} for row in rows)
    write_text(path, text.getvalue())


def _write_along_flow(path: Path, found: AlongFlow) -> None:
    bands = {"difference_along_flow": found.difference.elevation, "standard_deviation": found.std_m}
    for name, values in (("displacement", found.shift_m), ("displacement_std", found.shift_std_m)):
        bands |= {f"{name}_east": values[0], f"{name}_north": values[1]}
    write_raster(
        path, bands, found.difference.transform, found.difference.crs, found.difference.vertical_datum
    )
