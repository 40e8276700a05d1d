"""Plan document: outlines, no-go zones, starts and settings, as they are drawn; also while they are not complete."""

from typing import Annotated, Any, Literal, Self

import numpy as np
import shapely
from pydantic import Field, model_validator
from pyproj import CRS
from shapely import Polygon

from survey.core import InputError, Section
from survey.data.area import SurveyArea
from survey.data.outlines import MOST_CORNERS, check_polygon, unite

MOST_POINTS = 2_000
Place = tuple[float, float]
Ring = Annotated[tuple[Place, ...], Field(min_length=3)]
Rings = Annotated[tuple[Ring, ...], Field(min_length=1)]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_. -]{0,99}$")]
Setting = bool | int | float | str | tuple[float, float] | None

_FIRST_SETTINGS: dict[str, Setting] = {"pattern": "lawnmower", "swaths": 8}


class Record(Section, use_attribute_docstrings=False):
    """Section of a desk's file or of a request of its page: no form shows its fields, so their docstrings are not read."""


class PlanDocument(Record):
    """Survey as it is drawn on the desk; places in the metres of the terrain's CRS.

    Settings are those of the sections of a mission file, without defaults. They are checked when the plan
    is computed, so that a document can be stored while an outline crosses itself.

    >>> square = ((0.0, 0.0), (90.0, 0.0), (90.0, 90.0), (0.0, 90.0))
    >>> PlanDocument(areas=((square,),), planner={"pattern": "lawnmower", "swaths": 3}).n_vertices
    4
    """

    schema_version: Literal[1] = 1
    """Version of the format."""
    areas: tuple[Rings, ...] = ()
    """Polygons to survey: an outline and its holes each."""
    no_go: tuple[Rings, ...] = ()
    """Polygons that no route may touch."""
    starts: tuple[Place, ...] = ()
    """Where rovers start."""
    stakes: tuple[Place, ...] = Field(default=(), max_length=MOST_POINTS)
    """Where stakes are to be set and surveyed."""
    checkpoints: tuple[Place, ...] = Field(default=(), max_length=MOST_POINTS)
    """Where the map is to be checked by heights that it is not made from."""
    planner: dict[str, Setting] = Field(default_factory=lambda: dict(_FIRST_SETTINGS))
    """Settings of the section ``planner``."""
    rover: dict[str, Setting] = Field(default_factory=dict)
    """Settings of the section ``rover``."""
    fleet: dict[str, Setting] = Field(default_factory=dict)
    """Settings of the section ``fleet``."""
    requirement: dict[str, Setting] = Field(default_factory=dict)
    """Settings of a required class or error; empty when the pattern is chosen by hand."""
    simulation: dict[str, Setting] = Field(default_factory=dict)
    """Depth and seed of a simulated run."""
    notes: str = Field(default="", max_length=10_000)
    """What its author wants to remember of the plan."""
    measured: dict[Literal["points", "checkpoints", "driven"], FileName] = Field(default_factory=dict)
    """Files of real measurements in the folder of the plan's measurements."""

    @model_validator(mode="after")
    def _of_bearable_size(self) -> Self:
        if self.n_vertices > MOST_CORNERS:
            raise ValueError(f"{self.n_vertices} corners were drawn; {MOST_CORNERS} are accepted")
        return self

    @property
    def n_vertices(self) -> int:
        """Number of corners of all polygons."""
        return sum(len(ring) for rings in (*self.areas, *self.no_go) for ring in rings)

    @classmethod
    def of_area(cls, area: SurveyArea, **settings: Any) -> Self:
        """Return the document of an area."""
        polygons = shapely.get_parts(area.polygon)
        return cls(
            areas=tuple(_rings(part) for part in polygons),
            no_go=tuple(_rings(part) for part in area.no_go),
            starts=tuple((float(x), float(y)) for x, y in area.starts),
            **settings,
        )

    def survey_area(self, crs: CRS) -> SurveyArea:
        """Return the area that is drawn."""
        if not self.areas:
            raise InputError("no area is drawn yet; draw its outline on the map, or drop a file with it.")
        polygons = [_polygon(rings) for rings in self.areas]
        for number, polygon in enumerate(polygons, start=1):
            check_polygon(polygon, f"polygon {number} of the survey area")
        starts = np.array(self.starts, dtype=np.float64).reshape(-1, 2)
        return SurveyArea(unite(polygons, crs), crs, tuple(_polygon(rings) for rings in self.no_go), starts)


def _polygon(rings: tuple[Ring, ...]) -> Polygon:
    outline, *holes = (np.array(ring, dtype=np.float64) for ring in rings)  # many times as fast as tuples
    return Polygon(outline, holes)


def _rings(polygon: Polygon) -> tuple[Ring, ...]:
    """Return outline and holes without their closing corners."""
    lines = [polygon.exterior, *polygon.interiors]
    return tuple(tuple((float(x), float(y)) for x, y, *_ in line.coords[:-1]) for line in lines)
