"""Writers of routes, one for each file ending."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from shapely import LineString

from survey.core.arrays import FloatArray
from survey.core.crs.transformation import transformed
from survey.core.files.writing import replacing
from survey.data.route import Route
from survey.interchange.kml import write_kml, write_kmz
from survey.interchange.missions import write_qgc_plan, write_wpl
from survey.interchange.surroundings import Surroundings
from survey.io.degrees import WGS84, require_transformation
from survey.io.vector import write_features

_CSV_COLUMNS = (
    "rover", "leg", "kind", "waypoint", "easting_m", "northing_m", "longitude_deg", "latitude_deg",
)  # fmt: skip


def _lonlat(route: Route, xy: FloatArray, path: Path) -> FloatArray:
    """Return longitude and latitude (N, 2) [deg]; refuses a CRS that no transformation ties to the Earth."""
    require_transformation(route.crs, path)
    return transformed(xy, route.crs, WGS84, "the route")


def _write_gpkg(route: Route, path: Path, _: Surroundings) -> None:
    route.write(path)


def _write_geojson(route: Route, path: Path, around: Surroundings) -> None:
    """Write one line per leg in degrees, as RFC 7946 defines GeoJSON: longitude first, without a CRS."""
    features = []
    for order, (leg, length_m) in enumerate(zip(route.legs, route.ground_leg_lengths_m, strict=True)):
        facts = {
            "name": f"{order + 1} {leg.kind}, rover {leg.rover + 1}",
            "order": order,
            "kind": leg.kind,
            "rover": leg.rover,
            "length_m": round(float(length_m), 3),
        }
        places = np.round(_places(route, leg.xy, path, around), 9).tolist()
        geometry = {"type": "LineString", "coordinates": places}
        features.append({"type": "Feature", "properties": facts, "geometry": geometry})
    collection = {"type": "FeatureCollection", "features": features}
    _write_text(path, json.dumps(collection, ensure_ascii=False, indent=1) + "\n")


def _places(route: Route, xy: FloatArray, path: Path, around: Surroundings) -> FloatArray:
    """Return longitude, latitude and, where the terrain is known, height (N, 2 or 3)."""
    heights = around.heights(xy)
    degrees = _lonlat(route, xy, path)
    return degrees if heights is None else np.column_stack([degrees, np.round(heights, 2)])


def _write_gpx(route: Route, path: Path, around: Surroundings) -> None:
    rovers = range(route.n_rovers)
    lines = [LineString(np.round(_places(route, route.path(k), path, around), 9)) for k in rovers]
    names = np.array([f"{route.pattern}, rover {rover + 1}" for rover in rovers], dtype=object)
    columns = {"name": names, "number": np.array(rovers, dtype=np.int32) + 1}
    write_features(path, lines, columns, WGS84, layer="routes")


def _write_csv(route: Route, path: Path, _: Surroundings) -> None:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_CSV_COLUMNS)
    for index, leg in enumerate(route.legs):
        for k, (here, degrees) in enumerate(zip(leg.xy, _lonlat(route, leg.xy, path), strict=True)):
            metres = [f"{value:.4f}" for value in here]
            rows.writerow([leg.rover, index, leg.kind, k, *metres, *(f"{value:.9f}" for value in degrees)])
    _write_text(path, text.getvalue())


def _write_wkt(route: Route, path: Path, _: Surroundings) -> None:
    _write_text(
        path, "".join(shapely.to_wkt(LineString(leg.xy), rounding_precision=-1) + "\n" for leg in route.legs)
    )


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")


WRITERS: dict[str, Callable[[Route, Path, Surroundings], None]] = {
    ".csv": _write_csv,
    ".geojson": _write_geojson,
    ".gpkg": _write_gpkg,
    ".gpx": _write_gpx,
    ".json": _write_geojson,
    ".kml": write_kml,
    ".kmz": write_kmz,
    ".plan": write_qgc_plan,
    ".waypoints": write_wpl,
    ".wkt": _write_wkt,
}
