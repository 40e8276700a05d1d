"""Write a change as rasters, as a table for spreadsheets, and as JSON."""

import csv
import io
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.documents import write_json
from survey.core.files.writing import replacing
from survey.core.text import csv_cell
from survey.io.raster import write_raster
from survey.scoring.change.results import AlongFlow, Change

TABLE_COLUMNS = (
    "name",
    "area_m2",
    "known_share",
    "mean_change_m",
    "volume_change_m3",
    "volume_std_m3",
    "volume_low_95_m3",
    "volume_high_95_m3",
    "naive_std_m3",
    "mass_change_kg",
    "mass_std_kg",
    "specific_mass_balance_m_we",
    "specific_std_m_we",
)


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

    Raises
    ------
    InputError
        When the folder is missing or cannot be written to.
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
    with replacing(place / "change.csv") as draft:
        draft.write_text(text.getvalue(), encoding="utf-8", newline="\n")
    write_json(place / "change.json", facts)


def _write_along_flow(path: Path, found: AlongFlow) -> None:
    bands = {"difference_along_flow": found.difference.elevation, "standard_deviation": found.std_m}
    for name, values in (("displacement", found.shift_m), ("displacement_std", found.shift_std_m)):
        bands |= {f"{name}_east": values[0], f"{name}_north": values[1]}
    write_raster(
        path, bands, found.difference.transform, found.difference.crs, found.difference.vertical_datum
    )
