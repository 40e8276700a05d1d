"""Survey areas: outline, no-go zones and start points of rovers.

`SurveyArea` holds valid polygons in one projected CRS. Its file has features with a role each, which
`survey.data.outlines` checks, unites and transforms into the CRS. Lengths and areas count on the ground.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import shapely
from pyproj import CRS
from shapely import MultiPolygon, Point, Polygon

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    checked,
    projected_crs,
    same_crs,
)
from survey.core.map_scale import ground_area_m2
from survey.data.conversions import to_geodataframe
from survey.data.outlines import (
    ROLES,
    Outlines,
    check_polygon,
    prepared,
    read_outlines_file,
    simple_rings,
    simplified,
)
from survey.io.vector import write_features

if TYPE_CHECKING:
    from geopandas import GeoDataFrame


@dataclass(frozen=True, eq=False, repr=False)
class SurveyArea(DataObject):
    """Ground to be mapped, in a projected CRS.

    Parameters
    ----------
    polygon : shapely.Polygon or shapely.MultiPolygon
        Outline [m]; holes count as no-go ground.
    crs : str or pyproj.CRS
        Projected, in metres.
    no_go : tuple of shapely.Polygon
        Ground that no route may touch.
    starts : (K, 2) array_like
        Where rovers start [m]; none by default.
    reference : (2,) array_like, optional
        The point from which scientific value is counted (Eq. 11); the centroid by default.

    Raises
    ------
    InputError
        An outline that is empty, crosses itself or is no polygon; no-go ground that
        leaves nothing; a start outside the free ground; a CRS in degrees.

    Examples
    --------
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> area.farthest_m
    424.26
    """

    polygon: Polygon | MultiPolygon
    crs: CRS
    no_go: tuple[Polygon, ...] = ()
    starts: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    reference: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "crs", projected_crs(self.crs, "the survey area"))
        object.__setattr__(self, "polygon", simple_rings(self.polygon))
        check_polygon(self.polygon, "the survey area")
        for index, polygon in enumerate(self.no_go, start=1):
            check_polygon(polygon, f"no-go zone {index}")
        if self.free.is_empty or self.free.area <= 0.0:
            raise InputError(
                "the no-go zones cover the whole survey area; nothing is left to survey, make one of them smaller."
            )
        centre = self.polygon.centroid
        point = (centre.x, centre.y) if self.reference is None else self.reference
        object.__setattr__(self, "reference", checked(point, (2,), "the reference point"))
        object.__setattr__(self, "starts", checked(self.starts, (None, 2), "the start points"))
        for start in self.starts:
            if not self.free.covers(Point(start)):
                raise InputError(
                    f"the start ({start[0]:.1f}, {start[1]:.1f}) is outside the area or in a no-go zone; move it to "
                    "free ground (a point of an area file is a start)."
                )

    @classmethod
    def rectangle(cls, bounds: tuple[float, float, float, float], crs: Any) -> Self:
        """Return the rectangle ``(xmin, ymin, xmax, ymax)`` [m].

        Parameters
        ----------
        bounds : (4,) tuple of float
            ``(xmin, ymin, xmax, ymax)`` [m].
        crs : str or pyproj.CRS
            Projected, in metres.

        Returns
        -------
        SurveyArea
            Without no-go ground and starts.
        """
        xmin, ymin, xmax, ymax = checked(bounds, (4,), "the area's bounds").tolist()
        if xmax <= xmin or ymax <= ymin:
            raise InputError(
                f"the area's bounds {tuple(bounds)} enclose nothing; give (xmin, ymin, xmax, ymax)."
            )
        return cls(shapely.box(xmin, ymin, xmax, ymax), crs)

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        crs: Any = None,
        layer: str | int | None = None,
        select: Sequence[str] = (),
    ) -> Self:
        """Read an area from GeoJSON, GeoPackage, KML, KMZ, Shapefile or FlatGeobuf.

        Features have the role ``area``, ``no-go`` or ``start`` in a text column ``role``;
        without it every polygon is area and every point a start. Rings may touch themselves, not cross.
        Neighbours less than 0.2 m apart are joined, and an outline of more than 20,000 corners is simplified by 0.5 m at most;
        the log states both.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        crs : str or pyproj.CRS, optional
            The projected CRS to work in.
        layer : str or int, optional
            The layer; the only one with polygons by default.
        select : str or sequence of str
            Which polygons: names, or ``COLUMN=VALUE`` such as ``RGIId=RGI60-11.00897``; ``*`` stands for any
            letters. No-go zones and starts are always read.

        Returns
        -------
        SurveyArea
            In `crs`, or in the file's own projected CRS. An area in degrees (GeoJSON, KML) is projected to
            its UTM zone, or to polar stereographic beyond 84° N and 80° S; the log states it.

        Raises
        ------
        InputError
            The file is missing or damaged, or holds no polygon; without roles, a polygon inside another one.
        """
        what = "the area file"
        try:
            outlines = read_outlines_file(path, what, layer=layer, select=select)
            if not select and outlines.of_inventory:
                n = int(outlines.is_area.sum())
                raise InputError(
                    f"{what} {path} holds {n} glaciers ({outlines.listed()}); choose with --select (select=), such as "
                    f"--select {shlex.quote(outlines.keys[0])}, or all with --select '*'."
                )
            return cls._from_outlines(prepared(outlines, crs))
        except InputError as error:
            message = str(error)
            raise type(error)(message if str(path) in message else f"{path}: {message}") from error

    @classmethod
    def _from_outlines(cls, outlines: Outlines) -> Self:
        by_role: dict[str, list[Any]] = {role: [] for role in ROLES}
        for shape, role in zip(outlines.features.geometry, outlines.roles, strict=True):
            by_role[role].append(shape)
        if not by_role["area"]:
            raise InputError("there is no polygon to survey; draw one and save it again.")
        outline = simplified(by_role["area"][0], outlines.where)
        starts = shapely.get_coordinates(by_role["start"])
        return cls(outline, outlines.features.crs, tuple(by_role["no-go"]), starts)

    def write(self, path: str | Path) -> None:
        """Write outline, no-go zones and starts with a ``role`` column.

        Parameters
        ----------
        path : str or pathlib.Path
            The file; ``.gpkg``, ``.geojson``, ``.kml`` or ``.shp``.
        """
        shapes, roles = self._shapes_and_roles()
        write_features(path, shapes, {"role": np.array(roles, dtype=object)}, self.crs, layer="area")

    def to_geodataframe(self) -> "GeoDataFrame":
        """Return outline, no-go zones and starts as a table with a ``role`` column.

        Returns
        -------
        geopandas.GeoDataFrame
            The outline first, then no-go zones, then starts.

        Raises
        ------
        InputError
            When GeoPandas is not installed.
        """
        shapes, roles = self._shapes_and_roles()
        return to_geodataframe(shapes, {"role": roles}, self.crs)

    def _shapes_and_roles(self) -> tuple[list[Any], list[str]]:
        shapes = [self.polygon, *self.no_go, *(Point(start) for start in self.starts)]
        return shapes, ["area"] + ["no-go"] * len(self.no_go) + ["start"] * len(self.starts)

    def _summary(self) -> str:
        parts = [
            f"{ground_area_m2(self.crs, self.polygon):.0f} m²",
            f"{len(self.no_go)} no-go zones",
            f"{len(self.starts)} starts",
        ]
        return ", ".join([*parts, self.crs.name])

    @cached_property
    def free(self) -> Polygon | MultiPolygon:
        """The outline less its no-go zones."""
        if not self.no_go:
            return self.polygon
        rest = self.polygon.difference(shapely.union_all(list(self.no_go)))
        parts = [part for part in shapely.get_parts(rest) if part.geom_type == "Polygon"]
        return parts[0] if len(parts) == 1 else MultiPolygon(parts)

    @cached_property
    def ground_area_m2(self) -> float:
        """Area of the free ground on the ground [m²]: the areal scale factor of the CRS is applied."""
        return ground_area_m2(self.crs, self.free)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the outline [m]."""
        xmin, ymin, xmax, ymax = self.polygon.bounds
        return xmin, ymin, xmax, ymax

    @cached_property
    def farthest_m(self) -> float:
        """Distance from the reference to the farthest point of the outline [m] (D_max of Eq. 13)."""
        corners = shapely.get_coordinates(self.polygon)
        return float(np.hypot(*(corners - self.reference).T).max())

    def contains(self, xy: Any) -> BoolArray:
        """Return which points lie on ground to be mapped: the outline, edge included, less the no-go zones.

        Parameters
        ----------
        xy : (N, 2) array_like
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray of bool
            True on free ground, its edge included.
        """
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        shapely.prepare(self.free)
        inside: BoolArray = shapely.intersects_xy(self.free, points[:, 0], points[:, 1])
        return inside

    def require_crs(self, crs: CRS, what: str) -> None:
        """Refuse when the area is in another CRS than `what`.

        Parameters
        ----------
        crs : pyproj.CRS
            The CRS that the area is to have.
        what : str
            What has it, for the message.
        """
        same_crs(self.crs, crs, f"the survey area and {what}")
