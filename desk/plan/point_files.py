"""Files of stakes and checkpoints, for receivers and for ``firnline score --checkpoints`` once they are measured."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely

from desk.plan.document import PlanDocument
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files import replacing
from survey.core.transformation import WGS84, transformed
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.io.vector import require_transformation, write_features

_COLUMNS = ("name", "kind", "easting_m", "northing_m", "longitude_deg", "latitude_deg", "prior_height_m")


def write_points(document: PlanDocument, area: SurveyArea, prior: Dem | None, file: Path) -> None:
    """Write stakes and checkpoints with names, as CSV, GPX or GeoPackage by the ending."""
    named = list(_named(document))
    if not named:
        raise InputError("no stake and no checkpoint is marked; mark one on the map first.")
    require_transformation(area.crs, file)
    names, kinds = [name for name, _, _ in named], [kind for _, kind, _ in named]
    xy = np.array([place for _, _, place in named])
    degrees = transformed(xy, area.crs, WGS84, "the points")
    heights = np.full(len(xy), np.nan) if prior is None else prior.at(xy)
    if file.suffix == ".csv":
        _write_csv(file, names, kinds, np.column_stack([xy, degrees, heights]))
        return
    is_gpx = file.suffix == ".gpx"
    columns = {
        "name": np.array(names, dtype=object),
        ("type" if is_gpx else "kind"): np.array(kinds, dtype=object),
    }
    places = shapely.points(degrees if is_gpx else xy)
    write_features(
        file, list(places), columns, WGS84 if is_gpx else area.crs, layer="waypoints" if is_gpx else "points"
    )


def _named(document: PlanDocument) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Yield name, kind and place of each point."""
    for kind, letter, places in (("stake", "S", document.stakes), ("checkpoint", "C", document.checkpoints)):
        for k, place in enumerate(places, 1):
            yield f"{letter}{k:02d}", kind, place


def _write_csv(file: Path, names: list[str], kinds: list[str], values: FloatArray) -> None:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_COLUMNS)
    for name, kind, (x, y, longitude, latitude, height) in zip(names, kinds, values, strict=True):
        known = "" if np.isnan(height) else f"{height:.2f}"
        rows.writerow([name, kind, f"{x:.3f}", f"{y:.3f}", f"{longitude:.9f}", f"{latitude:.9f}", known])
    with replacing(file) as draft:
        draft.write_text(text.getvalue(), encoding="utf-8")
