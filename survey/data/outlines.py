"""Outlines of files: features with roles become polygons that a survey can be planned on, or are refused.

Polygons are chosen by their attributes, as glaciers of an inventory are. Their rings are made simple; a part inside
another part of one shape, or a polygon inside another one without a role, is refused. Neighbours that touch become one
polygon, in the CRS of the file, in which their common border is one line. What was closed or simplified is logged.
"""

import logging
import math
import shlex
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS
from shapely import MultiPolygon, Point, Polygon
from shapely.affinity import translate
from shapely.validation import explain_validity

from survey.core import InputError, frozen, printable, projected_crs
from survey.core.crs import is_local, known_crs, refuse_degrees, refuse_exchanged, refuse_far
from survey.core.lengths import log_converted
from survey.core.transformation import chosen_crs, is_geographic, metric_crs, transformed
from survey.io.vector import Features, polygon_layer, read_features

logger = logging.getLogger(__name__)

ROLES = ("area", "no-go", "start")
MOST_CORNERS = 50_000
"""Corners of an outline that can be planned on: more make the network of transits too large."""
_SAME_AREA = 1e-9
"""Share of an area by which rounding changes it."""
_INSIDE = 0.99
"""Share of a polygon in another one from which it counts as inside."""
# Names of glaciers in the Randolph inventory (5 to 7) and GLIMS, and of shapes in own files and KML.
_IDENTIFIERS = ("rgiid", "rgi_id", "glac_id", "glims_id", "glimsid")
_NAMES = ("name", "glac_name", *_IDENTIFIERS, "id")
_LISTED = 12


class Outlines(NamedTuple):
    """Features of a file with the role of each.

    `features`: shapes in the CRS of the file. `roles`: one of `ROLES` each. `where`: the file, for messages.
    """

    features: Features
    roles: list[str]
    where: str

    @property
    def is_area(self) -> npt.NDArray[np.bool_]:
        """Which features are ground to survey."""
        return np.array([role == "area" for role in self.roles])

    @property
    def names(self) -> list[str]:
        """Names of the features, numbered where they are missing or repeated."""
        columns = [self.features.attributes[name] for name in self._columns(_NAMES)]
        names: list[str] = []
        for k in range(len(self.roles)):
            name = next(filter(None, (_text(column[k]) for column in columns)), "outline")
            names.append(f"{name} {k + 1}" if name in names or name == "outline" else name)
        return names

    @property
    def keys(self) -> list[str]:
        """What each feature is chosen by: ``COLUMN=VALUE`` of an inventory, else its name."""
        column = next(iter(self._columns(_IDENTIFIERS)), None)
        if column is None:
            return self.names
        return [f"{column}={identifier}" for identifier in self.identifiers]

    @property
    def identifiers(self) -> list[str]:
        """Number of each feature in an inventory; empty where the file has none."""
        column = next(iter(self._columns(_IDENTIFIERS)), None)
        if column is None:
            return [""] * len(self.roles)
        return [_text(value) for value in self.features.attributes[column]]

    @property
    def of_inventory(self) -> bool:
        """Whether the polygons are several glaciers of an inventory."""
        return bool(self._columns(_IDENTIFIERS)) and len(set(np.array(self.keys)[self.is_area])) > 1

    def chosen(self, select: Sequence[str]) -> "Outlines":
        """Return the polygons that are named, with every no-go zone and start.

        `select`: a name, or ``COLUMN=VALUE``; ``*`` stands for any letters.
        """
        select = (select,) if isinstance(select, str) else select
        found = np.array([self._matching(wanted) for wanted in select]).reshape(-1, len(self.roles))
        for wanted, row in zip(select, found, strict=True):
            if not (row & self.is_area).any():
                raise InputError(f"{self.where} has no outline {wanted!r}; it holds {self.listed()}.")
        taken = found.any(axis=0) | ~self.is_area if len(select) else np.ones(len(self.roles), np.bool_)
        columns = {name: column[taken] for name, column in self.features.attributes.items()}
        features = Features(self.features.geometry[taken], columns, self.features.crs)
        return self._replace(features=features, roles=[self.roles[k] for k in np.flatnonzero(taken)])

    def listed(self) -> str:
        """Return how the largest polygons are chosen, with the names of glaciers, and how many more there are."""
        area = np.flatnonzero(self.is_area)
        order = area[np.argsort(-shapely.area(self.features.geometry[area]), kind="stable")]
        more = f" and {len(area) - _LISTED} more" if len(area) > _LISTED else ""
        return ", ".join(printable(self.titles[k]) for k in order[:_LISTED]) + more

    @property
    def titles(self) -> list[str]:
        """How each feature is chosen, and the name of a glacier of an inventory in brackets."""
        column = next(iter(self._columns(("name", "glac_name"))), None)
        if column is None or not self._columns(_IDENTIFIERS):
            return self.keys
        names = [" ".join(_text(value).split()) for value in self.features.attributes[column]]
        return [f"{key} ({name})" if name else key for key, name in zip(self.keys, names, strict=True)]

    def _columns(self, names: Sequence[str]) -> list[str]:
        """Return the columns of some names, whatever their capitals, in the order of the names."""
        present = {column.casefold(): column for column in self.features.attributes}
        return [present[name] for name in names if name in present]

    def _matching(self, wanted: str) -> npt.NDArray[np.bool_]:
        """Return which features a choice means."""
        column, is_stated, value = wanted.partition("=")
        columns = self._columns([column.strip().casefold()] if is_stated else _NAMES)
        if is_stated and not columns:
            known = ", ".join(map(printable, self.features.attributes)) or "none"
            raise InputError(f"{self.where} has no column {column!r} (found {known}); name one of those.")
        pattern = (value if is_stated else wanted).strip().casefold()
        texts = [[_text(v).casefold() for v in self.features.attributes[name]] for name in columns]
        if not is_stated:
            texts.append([name.casefold() for name in self.names])
        rows = [[text == pattern or fnmatchcase(text, pattern) for text in row] for row in texts]
        return np.asarray(np.array(rows, np.bool_).reshape(-1, len(self.roles)).any(axis=0))


def _text(value: Any) -> str:
    """Return a value of a column as text; whole numbers without decimals, and nothing where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.15g}" if isinstance(value, float) else str(value).strip()


def read_outlines_file(
    path: str | Path,
    what: str,
    *,
    layer: str | int | None = None,
    select: Sequence[str] = (),
    has_roles: bool = True,
) -> Outlines:
    """Read the features of a file of outlines, or those of them that are named (`Outlines.chosen`).

    `what`: what the file is, for messages. `has_roles`: whether features have roles; without, all are outlines.
    """
    layer = polygon_layer(path, what=what) if layer is None else layer
    features = read_features(path, layer=layer, what=what)
    roles = roles_of(features) if has_roles else ["area"] * len(features.geometry)
    return Outlines(features, roles, f"{what} {path}").chosen(select)


def roles_of(features: Features) -> list[str]:
    """Return the role of each feature; points without one are starts."""
    column = role_column(features)
    if column is None:
        return [
            "start" if shape is not None and "Point" in shape.geom_type else "area"
            for shape in features.geometry
        ]
    roles = [_text(value).casefold() for value in features.attributes[column]]
    for number, value in enumerate(roles, start=1):
        if value not in ROLES:
            role = f"the role {value!r}" if value else "no role"
            raise InputError(f"feature {number} has {role}; one of {', '.join(ROLES)} was expected.")
    return roles


def role_column(features: Features) -> str | None:
    """Return the name of the column of roles, whatever its capitals."""
    return next((name for name in features.attributes if name.casefold() == "role"), None)


def refuse_nested(features: Features, *, only_parts: bool = False) -> None:
    """Refuse a part inside another part of its shape, and a polygon inside another one where no column states roles.

    The first is a hole that is wound like its outline, or ground that counts twice; the second may well be ground to
    stay off. `only_parts`: whether polygons may lie inside others.
    """
    only_parts = only_parts or role_column(features) is not None
    shapes = [shape if isinstance(shape, Polygon | MultiPolygon) else None for shape in features.geometry]
    parts, owner = shapely.get_parts(shapes, return_index=True)
    size = shapely.area(parts)
    inner, outer = shapely.STRtree(parts).query(parts, predicate="intersects") if len(parts) > 1 else ([], [])
    # Equal polygons are one that was saved twice.
    pairs = [(i, o) for i, o in zip(inner, outer, strict=True) if size[i] < _INSIDE * size[o]]
    for i, o in pairs:
        is_one = owner[i] == owner[o]
        if (only_parts and not is_one) or (parts[i].intersection(parts[o]).area < _INSIDE * size[i]):
            continue
        if is_one:
            raise InputError(
                f"feature {owner[i] + 1} has a part inside another part of it, around {_place(parts[i])}: a hole that is wound like "
                "its outline, or ground that counts twice; correct it in a GIS (Fix geometries)."
            )
        raise InputError(
            f"polygon {owner[i] + 1} lies inside polygon {owner[o] + 1} and adds nothing to the area; give every feature a "
            f"role ({', '.join(ROLES)}) in a text column 'role' if no rover may drive there, or delete it."
        )


def _place(shape: Any) -> str:
    x, y = shape.representative_point().coords[0]
    return f"({x:.9g}, {y:.9g})"


def with_simple_rings(features: Features) -> Features:
    """Return the features with rings that touch themselves as simple rings; refuse polygons that cross themselves."""
    shapes = np.array([simple_rings(shape) for shape in features.geometry], dtype=object)
    for number, shape in enumerate(shapes, start=1):
        for part in shapely.get_parts(shape) if isinstance(shape, Polygon | MultiPolygon) else ():
            if not np.isfinite(shapely.get_coordinates(part)).all():
                raise InputError(f"feature {number} has corners that are NaN or infinite; correct them.")
            if not part.is_valid:
                raise InputError(
                    f"feature {number} is not a simple polygon ({explain_validity(part)}); correct it in a GIS."
                )
    return features._replace(geometry=shapes)


def simple_rings(shape: Any) -> Any:
    """Return the same ground bounded by rings that do not touch themselves, or the shape where its rings cross.

    Outlines of glaciers often touch themselves at a point, such as where a nunatak meets the margin. The ground that
    they bound is the same however it is counted: the sum of their corners gives its area.
    """
    if not isinstance(shape, Polygon | MultiPolygon) or shape.is_valid:
        return shape
    parts = [_simple_part(part) for part in shapely.get_parts(shape)]
    polygons = [polygon for part in parts for polygon in shapely.get_parts(part)]
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


def _simple_part(polygon: Polygon) -> Polygon | MultiPolygon:
    if polygon.is_valid or not np.isfinite(shapely.get_coordinates(polygon)).all():
        return polygon
    found = [part for part in shapely.get_parts(shapely.make_valid(polygon)) if part.geom_type == "Polygon"]
    simple = MultiPolygon(found)
    is_same = len(found) > 0 and abs(simple.area - polygon.area) <= _SAME_AREA * polygon.area
    return simple if is_same else polygon


def prepared(outlines: Outlines, crs: Any) -> Outlines:
    """Return checked outlines in the named CRS, else in their own (`in_crs`): the area as one shape, then the others."""
    features = with_simple_rings(outlines.features)
    refuse_nested(features)
    by_role: dict[str, list[Any]] = {role: [] for role in ROLES}
    for number, (shape, role) in enumerate(zip(features.geometry, outlines.roles, strict=True), start=1):
        by_role[role] += (points_of if role == "start" else polygon_parts)(shape, f"feature {number}")
    _require_crs(features, outlines.where)
    if crs is None and is_geographic(features.crs):
        crs = _crs_about(outlines)
    areas = [unite(by_role["area"], features.crs)] if by_role["area"] else []
    shapes = np.array([*areas, *by_role["no-go"], *by_role["start"]], dtype=object)
    roles = ["area"] * len(areas) + ["no-go"] * len(by_role["no-go"]) + ["start"] * len(by_role["start"])
    return Outlines(in_crs(Features(shapes, {}, features.crs), crs, outlines.where), roles, outlines.where)


def _require_crs(features: Features, where: str) -> None:
    if features.crs is None:
        raise InputError(
            f"{where} carries no coordinate reference system; save it with one (a Shapefile has it in the .prj beside it)."
        )


def in_crs(features: Features, crs: Any, where: str) -> Features:
    """Return the features in the named CRS, else in their own projected one; refuse a shape that folds over in it."""
    _require_crs(features, where)
    if not is_local(features.crs):
        _refuse_misplaced(features, known_crs(features.crs, where), where)
    stated = metric_crs(features.crs, where)
    log_converted(where, [("places", stated.place_m)])
    if crs is None and stated.place_m == 1.0:
        return features._replace(crs=projected_crs(features.crs, where))
    target = projected_crs(stated.crs if crs is None else metric_crs(crs, where).crs, "the wanted CRS")
    moved = shapely.transform(features.geometry, lambda xy: transformed(xy, features.crs, target, where))
    for number, shape in enumerate(map(simple_rings, moved), start=1):
        if features.geometry[number - 1].is_valid and not shape.is_valid:
            raise InputError(
                f"{where}: outline {number} cannot be shown in {target.name}, where it crosses itself ({explain_validity(shape)}); "
                "choose outlines near each other (--select), or a CRS made for this ground."
            )
    return features._replace(geometry=moved, crs=target)


def _crs_about(outlines: Outlines) -> CRS:
    """Return the projected CRS of outlines in degrees, and log it; refuse ground that reaches too far for one."""
    shapes, where = outlines.features.geometry, outlines.where
    places, owner = shapely.get_coordinates(shapes, return_index=True)
    crs = chosen_crs(places[:, 0], places[:, 1], outlines.features.crs)
    lon, lat = np.deg2rad(places).T
    directions = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    middle = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
    far_m = _EARTH_M * np.arccos(np.clip(directions @ middle, -1.0, 1.0))
    if far_m.max() > _REACH_M:
        far = printable(outlines.names[owner[far_m.argmax()]])
        smallest = np.argmin(np.where(outlines.is_area, shapely.area(shapes), np.inf))
        remedy = f"choose outlines near each other with --select (select=), such as --select {shlex.quote(outlines.keys[smallest])}"
        raise InputError(
            f"{where} reaches {far_m.max() / 1e3:,.0f} km from its middle ({far}), and a UTM zone serves "
            f"within {_REACH_M / 1e3:,.0f} km; {remedy if outlines.is_area.sum() > 1 else 'draw the ground to survey'}, or name a CRS (--crs, crs=)."
        )
    name = known_crs(outlines.features.crs, where).name
    logger.warning("%s is in degrees (%s); it is projected to %s.", where, name, crs.name)
    return crs


_REACH_M = 2e6
"""How far ground lies from its middle at most: there UTM shows lengths a twentieth too long [m]."""
_EARTH_M = 6.371e6


def _refuse_misplaced(features: Features, crs: CRS, where: str) -> None:
    """Refuse features in metres whose easting and northing are exchanged or degrees."""
    if crs.is_projected:
        refuse_exchanged(shapely.get_coordinates(features.geometry), crs, where)
        refuse_degrees(shapely.get_coordinates(features.geometry), crs, where)


def polygon_parts(shape: Any, what: str) -> list[Polygon]:
    """Return the polygons of a shape, without heights."""
    if shape is None:
        raise InputError(f"{what} has no shape that can be read; delete it, or draw it as a polygon.")
    if not isinstance(shape, Polygon | MultiPolygon):
        raise InputError(
            f"{what} is a {shape.geom_type}; a polygon was expected, close the line and save it as one."
        )
    parts = [shapely.force_2d(part) for part in shapely.get_parts(shape)]
    if not parts or any(part.is_empty for part in parts):
        raise InputError(
            f"{what} is an empty polygon; close each ring (its last place is its first one) or draw it again."
        )
    return parts


def points_of(shape: Any, what: str) -> list[Point]:
    """Return the points of a start."""
    if shape is None or shape.geom_type not in ("Point", "MultiPoint"):
        raise InputError(f"{what} is a start and no point; draw it as a point.")
    return list(shapely.get_parts(shape))


TOUCHING_M = 0.2
"""Neighbours this near are one: no rover has room between them, and six decimals of a degree round to 0.11 m [m]."""
_METRES_PER_DEGREE = 111_195.0
_ROUNDING_M, _ROUNDING_M2 = 1e-6, 1e-6


def unite(polygons: list[Polygon], crs: Any) -> Polygon | MultiPolygon:
    """Return the union of polygons; gaps between neighbours that touch are closed, and the log states where.

    Polygons in degrees that were cut at 180° of longitude meet there.
    """
    if len(polygons) == 1:
        return polygons[0]
    if is_geographic(crs) and _meet_at_180(polygons):
        polygons = [translate(one, 360.0 if one.bounds[2] <= 0.0 else 0.0) for one in polygons]
    scale = _metres_per_unit(polygons, crs)
    plane = np.array([shapely.transform(one, lambda xy: xy * scale) for one in polygons])
    union = shapely.union_all(plane)
    closed = _closed(plane, union)
    gaps = [gap for gap in shapely.get_parts(closed.difference(union)) if gap.area > _ROUNDING_M2]
    if gaps:
        places = [_place(shapely.transform(gap, lambda xy: xy / scale)) for gap in gaps[:_LISTED]]
        logger.warning(
            "outlines lie up to %g m apart around %s%s; the gaps of %.2g m² between them are closed.",
            TOUCHING_M,
            ", ".join(places),
            f" and {len(gaps) - _LISTED} more places" if len(gaps) > _LISTED else "",
            sum(gap.area for gap in gaps),
        )
    joined = shapely.transform(shapely.union_all([union, closed]), lambda xy: xy / scale)
    parts = [part for part in shapely.get_parts(joined) if part.geom_type == "Polygon"]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _metres_per_unit(polygons: list[Polygon], crs: Any) -> npt.NDArray[np.float64]:
    """Return the metres (2,) of a unit of the coordinates, about the middle of polygons in degrees."""
    if not is_geographic(crs):
        axes = [] if crs is None else known_crs(crs, "the outlines").axis_info
        return np.full(2, axes[0].unit_conversion_factor if axes else 1.0)
    bounds = shapely.bounds(polygons)
    middle_deg = 0.5 * (bounds[:, 1].min() + bounds[:, 3].max())
    return _METRES_PER_DEGREE * np.array([max(np.cos(np.deg2rad(middle_deg)), 1e-3), 1.0])


def _meet_at_180(polygons: list[Polygon]) -> bool:
    """Return whether polygons in degrees end at 180° of longitude from both sides."""
    west, east = shapely.bounds(polygons)[:, 0], shapely.bounds(polygons)[:, 2]
    return bool(west.min() <= -180.0 + 1e-5 and east.max() >= 180.0 - 1e-5 and (east - west).max() < 180.0)


def _closed(plane: npt.NDArray[Any], union: Any) -> Any:
    """Return the ground near several polygons [m] without the gaps between those that nearly touch."""
    first, second = shapely.STRtree(plane).query(plane, predicate="dwithin", distance=TOUCHING_M)
    grown = shapely.buffer(plane, TOUCHING_M)
    pairs = [(i, k) for i, k in zip(first, second, strict=True) if i < k]
    near_both = shapely.union_all([grown[i].intersection(grown[k]) for i, k in pairs])
    about = union.intersection(near_both.buffer(2.0 * TOUCHING_M))
    half = 0.5 * TOUCHING_M + _ROUNDING_M
    closed = about.buffer(half, join_style="mitre").buffer(-half, join_style="mitre")
    return closed.intersection(near_both)


def simplified(polygon: Any, where: str) -> Any:
    """Return an outline of many corners with fewer of them, moved by less than a rover's position is known; the log states it."""
    n_corners = int(shapely.get_num_coordinates(polygon))
    if n_corners <= _MANY_CORNERS:
        return polygon
    simple = polygon
    for step_m in _SIMPLER_M:
        simple = polygon.simplify(step_m)
        if shapely.get_num_coordinates(simple) <= _MANY_CORNERS:
            break
    n_left = int(shapely.get_num_coordinates(simple))
    if n_left < n_corners:
        logger.warning(
            "%s has an outline of %d corners; it is simplified to %d, by which it moves %g m at most.",
            where,
            n_corners,
            n_left,
            step_m,
        )
    return simple


_MANY_CORNERS = 20_000
_SIMPLER_M = (0.1, 0.2, 0.5)


def check_polygon(polygon: Any, what: str) -> None:
    """Refuse a polygon that is empty, not simple, without an area, or not on Earth."""
    if not isinstance(polygon, Polygon | MultiPolygon):
        raise InputError(f"{what} is a {getattr(polygon, 'geom_type', 'value')}; a polygon was expected.")
    if polygon.is_empty:
        raise InputError(f"{what} is an empty polygon; draw at least three corners.")
    if not np.isfinite(frozen(shapely.get_coordinates(polygon))).all():
        raise InputError(f"{what} has corners that are NaN or infinite; correct them.")
    refuse_far(shapely.get_coordinates(polygon), what)
    if not polygon.is_valid:
        raise InputError(
            f"{what} is not a simple polygon ({explain_validity(polygon)}); correct it in a GIS."
        )
    if polygon.area <= 0.0:
        raise InputError(
            f"{what} encloses no ground; draw at least three corners that do not lie on one line."
        )
