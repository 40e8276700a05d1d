"""Routes of a survey: for each rover, swaths to measure along and transits between them.

A `Route` is a sequence of `Leg` objects in a projected CRS. It gives lengths on the ground and samples along the path,
and is written as a GeoPackage with one line per leg.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
import shapely
from pyproj import CRS
from shapely import LineString

from survey.core import DataObject, FloatArray, InputError, IntArray, ReadOnlyMapping, checked, projected_crs
from survey.core.map_scale import ground_lengths_m
from survey.data.conversions import draw_lines, drawing, html_table, to_geodataframe
from survey.io.vector import Layer, layer_names, read_features, write_layers

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from matplotlib.axes import Axes


LegKind = Literal["swath", "transit"]

_APART_M = 0.01
"""Distance from a straight line within which a swath lies on it [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Leg(DataObject):
    """One stretch that a rover drives.

    Parameters
    ----------
    kind : {"swath", "transit"}
        A swath is driven to measure, a transit to get to the next one.
    xy : (N, 2) array_like
        Waypoints in driving order [m], at least two.
    rover : int
        Who drives it, counted from 0.
    axis : (2, 2) array_like, optional
        Both ends of the straight line that the swath deviates from; the first and the
        last waypoint by default. β (Eqs. 14–16) is measured from it.
    """

    kind: LegKind
    xy: FloatArray
    rover: int = 0
    axis: Any = None

    def __post_init__(self) -> None:
        xy = checked(self.xy, (None, 2), f"the waypoints of a {self.kind}")
        if self.kind not in ("swath", "transit"):
            raise InputError(f"a leg is of the kind {self.kind!r}; swath or transit was expected.")
        if len(xy) < 2:
            raise InputError(f"a {self.kind} has {len(xy)} waypoints; at least two are needed.")
        object.__setattr__(self, "xy", xy)
        axis = xy[[0, -1]] if self.axis is None else self.axis
        object.__setattr__(self, "axis", checked(axis, (2, 2), f"the axis of a {self.kind}"))

    def _summary(self) -> str:
        return f"{self.kind} of rover {self.rover}, {len(self.xy)} waypoints, {self.length_m:.1f} m"

    @property
    def length_m(self) -> float:
        """Distance along the waypoints in the CRS of the route [m]."""
        return float(np.hypot(*np.diff(self.xy, axis=0).T).sum())


class RouteSamples(NamedTuple):
    """Places at equal distances along one rover's path.

    `xy` (N, 2): easting and northing [m]. `distance_m` (N,): distance from the start along the path, in the
    CRS [m]. `leg` (N,) int: index into `Route.legs`. `heading_rad` (N,): counter-clockwise from east [rad].
    """

    xy: FloatArray
    distance_m: FloatArray
    leg: IntArray
    heading_rad: FloatArray

    def __repr__(self) -> str:
        return f"RouteSamples({len(self.xy)} places over {self.distance_m[-1]:.1f} m)"


_ENDINGS = (".geojson", ".json", ".gpkg")
_LAYER = "route"


@dataclass(frozen=True, eq=False, repr=False)
class Route(DataObject):
    """The legs of a survey in driving order.

    Parameters
    ----------
    legs : tuple of Leg
        For each rover in the order that it drives them.
    crs : str or pyproj.CRS
        Projected, in metres.
    pattern : str
        Name of the planner, e.g. ``"lawnmower"``.
    spacing_m : float, optional
        Distance between neighbouring swaths [m].
    prediction : mapping of str to float
        What the planner expects, units in the names: ``time_s``, ``energy_j``, ``rmse_m`` …

    Raises
    ------
    InputError
        No legs, or a leg that does not begin where the rover's previous one ended.

    Examples
    --------
    >>> route = Route((Leg("swath", [[0.0, 0.0], [3.0, 4.0]]),), "EPSG:32608", "line")
    >>> route.length_m
    5.0
    """

    legs: tuple[Leg, ...]
    crs: CRS
    pattern: str
    spacing_m: float | None = None
    prediction: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "crs", projected_crs(self.crs, "the route"))
        object.__setattr__(self, "legs", tuple(self.legs))
        object.__setattr__(self, "prediction", ReadOnlyMapping(dict(self.prediction)))
        if not self.legs:
            raise InputError("the route has no legs; plan at least one swath.")
        for rover in range(self.n_rovers):
            legs = [leg for leg in self.legs if leg.rover == rover]
            for before, after in pairwise(legs):
                gap_m = float(np.hypot(*(after.xy[0] - before.xy[-1])))
                if gap_m > 1e-6:
                    raise InputError(
                        f"rover {rover} jumps {gap_m:.2f} m between two legs; join them with a transit."
                    )

    @property
    def n_rovers(self) -> int:
        """Number of rovers."""
        return max(leg.rover for leg in self.legs) + 1

    @property
    def length_m(self) -> float:
        """Length of all legs together in the CRS [m]; `ground_length_m` is that on the ground."""
        return float(sum(leg.length_m for leg in self.legs))

    @cached_property
    def ground_length_m(self) -> float:
        """Distance that all rovers together drive over the ground, without relief [m].

        The length of the legs, each divided by the local scale factor of the CRS.
        """
        return float(self.ground_leg_lengths_m.sum())

    @cached_property
    def ground_leg_lengths_m(self) -> FloatArray:
        """Length of each leg on the ground [m], (L,)."""
        segments = ground_lengths_m(self.crs, np.vstack([leg.xy for leg in self.legs]))
        counts = np.array([len(leg.xy) for leg in self.legs])
        first = np.r_[0, np.cumsum(counts)[:-1]]
        sums = np.r_[0.0, np.cumsum(np.r_[segments, 0.0])]
        lengths: FloatArray = sums[first + counts - 1] - sums[first]
        return lengths

    @property
    def swaths(self) -> tuple[Leg, ...]:
        """The legs that are measured along."""
        return tuple(leg for leg in self.legs if leg.kind == "swath")

    @property
    def n_lines(self) -> int:
        """Number of straight lines that the swaths lie on; a concave border or no-go ground cuts a line into several swaths.

        >>> legs = (Leg("swath", [[0.0, 0.0], [4.0, 0.0]]), Leg("transit", [[4.0, 0.0], [6.0, 0.0]]),
        ...         Leg("swath", [[6.0, 0.0], [9.0, 0.0]]))
        >>> Route(legs, "EPSG:32608", "lawnmower").n_lines
        1
        """
        axes = np.array([swath.axis for swath in self.swaths])
        axes -= axes.mean(axis=(0, 1))
        along = axes[:, 1] - axes[:, 0]
        lengths = np.hypot(*along.T)
        left: list[int] = list(np.argsort(-lengths, kind="stable"))
        n = 0
        while left:
            # The longest axis left gives the direction of its line best.
            first = left[0]
            direction = along[first] / lengths[first]
            normal = np.array([-direction[1], direction[0]])
            off = np.abs((axes[left] - axes[first, 0]) @ normal).max(axis=1)
            left = [index for index, distance in zip(left, off, strict=True) if distance > _APART_M]
            n += 1
        return n

    def path(self, rover: int = 0) -> FloatArray:
        """Return one rover's waypoints (N, 2) [m], without repeated ones.

        Parameters
        ----------
        rover : int
            Counted from 0.

        Returns
        -------
        (N, 2) ndarray
            Easting and northing [m].
        """
        points = np.vstack([leg.xy for leg in self.legs if leg.rover == rover])
        keep = np.r_[True, np.hypot(*np.diff(points, axis=0).T) > 0.0]
        return points[keep]

    def sample(self, step_m: float, rover: int = 0) -> RouteSamples:
        """Return places every `step_m` along one rover's path, its start included.

        Parameters
        ----------
        step_m : float
            Distance between samples along the path, in the CRS [m].
        rover : int
            Counted from 0.

        Returns
        -------
        RouteSamples
            Places, distances, legs and headings.
        """
        if not step_m > 0:
            raise InputError(f"the sample spacing is {step_m} m; it must be greater than 0.")
        xy, owner = self._vertices(rover)
        ends = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
        distance = np.arange(0.0, ends[-1] + 1e-9, step_m)
        segment = np.clip(np.searchsorted(ends, distance, side="right") - 1, 0, len(ends) - 2)
        along = (distance - ends[segment]) / (ends[segment + 1] - ends[segment])
        direction = xy[segment + 1] - xy[segment]
        places = xy[segment] + along[:, None] * direction
        return RouteSamples(places, distance, owner[segment], np.arctan2(direction[:, 1], direction[:, 0]))

    def _vertices(self, rover: int) -> tuple[FloatArray, IntArray]:
        """Return the waypoints without repeats and, for each segment between them, its leg."""
        points: list[FloatArray] = []
        owner: list[int] = []
        for index, leg in enumerate(self.legs):
            if leg.rover != rover:
                continue
            fresh = leg.xy if not points else leg.xy[1:]
            points.extend(fresh)
            owner.extend([index] * (len(leg.xy) - 1))
        xy = np.array(points)
        moves = np.hypot(*np.diff(xy, axis=0).T) > 0.0
        if not moves.any():
            raise InputError(f"the path of rover {rover} has no length; give it two different waypoints.")
        return xy[np.r_[True, moves]], np.array(owner, dtype=np.int64)[moves]

    @cached_property
    def line(self) -> Any:
        """All legs as one multi-line geometry."""
        return shapely.multilinestrings([LineString(leg.xy) for leg in self.legs])

    def write(self, path: str | Path, *, also: Mapping[str, "Route"] | None = None) -> None:
        """Write the legs with rover, order, kind and what `read` reads back.

        Parameters
        ----------
        path : str or pathlib.Path
            Ends in ``.geojson``, ``.json`` or ``.gpkg``. A GeoJSON of a CRS without a registered code holds
            degrees and names the CRS in a column; both formats preserve the CRS.
        also : mapping of str to Route, optional
            Other routes in the same CRS, as further layers of a GeoPackage; `read` reads this one.

        Raises
        ------
        InputError
            Another ending (`survey.interchange.write_plan` writes GPX, KML, CSV, WKT and missions), a GeoJSON
            in a local CRS, a folder that is missing or cannot be written to.
        """
        suffix = Path(path).suffix.lower()
        if suffix not in _ENDINGS:
            raise InputError(
                f"{Path(path).name} ends in {suffix!r}; a route is written as {', '.join(_ENDINGS)}. "
                f"For other tools use survey.interchange.write_plan(route, {str(path)!r}) or firnline export, "
                "which also write .gpx, .kml, .csv, .wkt, .plan and .waypoints."
            )
        layers = {name: route._layer() for name, route in {_LAYER: self, **(also or {})}.items()}
        write_layers(path, layers, self.crs)

    def _layer(self) -> Layer:
        return Layer([LineString(leg.xy) for leg in self.legs], self._columns())

    def _columns(self) -> dict[str, Any]:
        """Return the attributes of the legs, one value for each leg."""
        n = len(self.legs)
        columns: dict[str, Any] = {
            "order": np.arange(n, dtype=np.int32),
            "kind": np.array([leg.kind for leg in self.legs], dtype=object),
            "rover": np.array([leg.rover for leg in self.legs], dtype=np.int32),
            "length_m": self.ground_leg_lengths_m,
            "pattern": np.array([self.pattern] * n, dtype=object),
            "spacing_m": np.full(n, np.nan if self.spacing_m is None else self.spacing_m),
        }
        for index, name in enumerate(("axis_x0_m", "axis_y0_m", "axis_x1_m", "axis_y1_m")):
            columns[name] = np.array([leg.axis.ravel()[index] for leg in self.legs])
        for name, value in self.prediction.items():
            columns[f"predicted_{name}"] = np.full(n, value)
        return columns

    @drawing
    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the swaths as solid and the transits as dashed lines, one colour for each rover.

        $axes
        """
        style = {"swath": "-", "transit": ":"}
        lines = [(leg.xy, {"linestyle": style[leg.kind], "color": f"C{leg.rover % 10}"}) for leg in self.legs]
        return draw_lines(ax, lines)

    def to_geodataframe(self) -> "GeoDataFrame":
        """Return the legs as a table: order, kind, rover, length and what `write` writes besides.

        Returns
        -------
        geopandas.GeoDataFrame
            One row for each leg, in driving order.

        Raises
        ------
        InputError
            When GeoPandas is not installed.
        """
        return to_geodataframe([LineString(leg.xy) for leg in self.legs], self._columns(), self.crs)

    def _facts(self) -> dict[str, str]:
        return {
            "pattern": self.pattern,
            "swaths": f"{len(self.swaths)} swath{'' if len(self.swaths) == 1 else 's'}",
            "length": f"{self.ground_length_m:.0f} m",
            "rovers": f"{self.n_rovers} rover{'s' if self.n_rovers > 1 else ''}",
            "CRS": self.crs.name,
        }

    def _summary(self) -> str:
        return ", ".join(self._facts().values())

    def _repr_html_(self) -> str:
        return html_table("Route", self._facts(), self.plot)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a route that `write` wrote.

        Parameters
        ----------
        path : str or pathlib.Path
            A GeoJSON or GeoPackage.

        Returns
        -------
        Route
            In the CRS of the file.

        Raises
        ------
        InputError
            Missing, damaged, or without the columns that `write` writes.
        """
        features = read_features(path, layer=_own_layer(path), what="the route")
        columns = features.attributes
        missing = {"order", "kind", "rover", "pattern", "spacing_m"} - set(columns)
        if missing:
            raise InputError(
                f"the route {path} lacks the columns {', '.join(sorted(missing))}; write it with firnline."
            )
        kinds = ["no geometry" if shape is None else f"a {shape.geom_type}" for shape in features.geometry]
        odd = next((number for number, kind in enumerate(kinds, 1) if kind != "a LineString"), None)
        if odd is not None:
            raise InputError(
                f"the route {path} has {kinds[odd - 1]} as feature {odd}; a line for each leg was expected, delete it."
            )
        axes = np.column_stack([columns[n] for n in ("axis_x0_m", "axis_y0_m", "axis_x1_m", "axis_y1_m")])
        legs = tuple(
            Leg(
                columns["kind"][i],
                shapely.get_coordinates(features.geometry[i]),
                int(columns["rover"][i]),
                axes[i].reshape(2, 2),
            )
            for i in np.argsort(columns["order"], kind="stable")
        )
        spacing = columns["spacing_m"][0]
        prefix = "predicted_"
        prediction = {
            name.removeprefix(prefix): float(v[0]) for name, v in columns.items() if name.startswith(prefix)
        }
        return cls(
            legs,
            features.crs,
            str(columns["pattern"][0]),
            None if spacing is None or np.isnan(spacing) else float(spacing),
            prediction,
        )


def _own_layer(path: str | Path) -> str | None:
    """Return the layer of the route where a GeoPackage holds others beside it."""
    if Path(path).suffix.lower() != ".gpkg":
        return None
    names = layer_names(path, what="the route")
    return _LAYER if len(names) > 1 and _LAYER in names else None
