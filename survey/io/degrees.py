"""Vector formats in degrees (GeoJSON, KML, GPX): which CRS they can name, and how any other one is preserved."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core.crs.transformation import transformed
from survey.core.errors import InputError

WGS84 = CRS("EPSG:4326")
SURVEY_CRS = "survey_crs"
"""Column of a GeoJSON in degrees that holds the projected CRS of its features as WKT."""


def require_transformation(crs: CRS, path: Path) -> None:
    """Refuse a CRS without a transformation to degrees for a file that holds degrees.

    Raises
    ------
    InputError
        A local (engineering) CRS; a format in metres is named.
    """
    source = crs.source_crs if crs.is_bound and crs.source_crs is not None else crs
    if source.geodetic_crs is None:
        raise InputError(
            f"{path.name} holds degrees, but {crs.name} is a local system that no transformation ties to the Earth; "
            "write GeoPackage (.gpkg), or assign the data the CRS that they were surveyed in."
        )


def in_degrees(
    geometry: npt.NDArray[Any], attributes: Mapping[str, Any], crs: CRS, path: Path
) -> tuple[npt.NDArray[Any], dict[str, Any]]:
    """Transform geometries to longitude and latitude, and add the column that names their CRS.

    Raises
    ------
    InputError
        As `require_transformation` does.
    """
    require_transformation(crs, path)
    moved = _moved(geometry, crs, WGS84, str(path))
    wkt = np.array([crs.to_wkt()] * len(geometry), dtype=object)
    return moved, {**attributes, SURVEY_CRS: wkt}


def in_survey_crs(
    geometry: npt.NDArray[Any], attributes: dict[str, npt.NDArray[Any]], where: str
) -> tuple[npt.NDArray[Any], dict[str, npt.NDArray[Any]], str]:
    """Transform geometries back to the CRS that the column `SURVEY_CRS` names, and return it as WKT.

    Raises
    ------
    InputError
        Features of several systems, or a system that PROJ does not know.
    """
    named = {str(value) for value in attributes[SURVEY_CRS]}
    if len(named) != 1:
        raise InputError(f"{where} names {len(named)} systems in its column {SURVEY_CRS}; one was expected.")
    wkt = named.pop()
    moved = _moved(geometry, WGS84, wkt, where)
    return moved, {name: column for name, column in attributes.items() if name != SURVEY_CRS}, wkt


def _moved(geometry: npt.NDArray[Any], source: Any, target: Any, where: str) -> npt.NDArray[Any]:
    """Transform easting and northing, and leave heights as they are."""

    def move(coordinates: npt.NDArray[Any]) -> npt.NDArray[Any]:
        places = transformed(coordinates[:, :2], source, target, where)
        return np.column_stack([places, coordinates[:, 2:]])

    has_z = bool(np.all(shapely.has_z(geometry)))
    return np.asarray(shapely.transform(geometry, move, include_z=has_z), dtype=object)
