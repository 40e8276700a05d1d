"""Files of a plan: routes, sheets and areas as the commands write them, missions, stakes and checkpoints."""

import csv
import io
import math
import re
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely
import tomlkit
from pydantic import Field

from desk.plan.document import PlanDocument
from desk.plan.history import History
from desk.plan.history_file import SUFFIX, StoredHistory
from desk.plan.live import LivePlan
from desk.plan.request import request_of
from firnline.actions.exporting import knows_heights, write_route
from firnline.actions.interface import read_about
from firnline.actions.plan_request import write_plan as write_outputs
from sim.config.mission import MissionConfig
from survey import Dem, InputError, Route, SurveyArea
from survey.core import FloatArray, Section, replacing, validated
from survey.core.transformation import WGS84, transformed
from survey.interchange.missions import Surroundings
from survey.io.vector import require_transformation, write_features

_MOST_TERRAIN_CELLS = 4_000_000
_MARGIN_CELLS = 2.0
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]+")


def write_mission(live: LivePlan, document: PlanDocument, name: str, folder: Path) -> Path:
    """Write a mission file with the area and the prior that it names.

    The true terrain of its simulation is drawn about the prior, as ``role = "prior"`` in a mission file says.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stem = _NOT_IN_NAMES.sub("-", name).strip("-._") or "survey"
    content = _mission(live, document, stem)
    validated(MissionConfig, content, "the mission of the plan")
    live.plan.area.write(folder / f"{stem}.gpkg")
    _mission_prior(live).write(folder / f"{stem}_prior.tif")
    place = folder / f"{stem}.toml"
    with replacing(place) as draft:
        draft.write_text(tomlkit.dumps(content), encoding="utf-8")
    return place


def _mission_prior(live: LivePlan) -> Dem:
    """Return the cells of the prior on the area and two more to each side."""
    if live.plan.prior is None:
        raise InputError("a mission needs a prior; open the desk with a raster of elevations.")
    prior = live.plan.prior
    west, south, east, north = live.plan.area.bounds
    margin_m = _MARGIN_CELLS * prior.step_m
    return prior.window((west - margin_m, south - margin_m, east + margin_m, north + margin_m))


def _mission(live: LivePlan, document: PlanDocument, stem: str) -> dict[str, Any]:
    """Return the settings of the mission; those at their defaults are left out."""
    given = document.model_dump(mode="json")
    sections = {name: _stated(given[name]) for name in ("planner", "rover", "fleet")}
    terrain = {"source": "dem", "file": f"{stem}_prior.tif", "role": "prior", "step_m": _step_m(live)}
    return {
        "schema_version": 1,
        "name": stem,
        "fidelity": "statistical",
        **_stated(given["simulation"]),
        "terrain": terrain,
        "area": {"file": f"{stem}.gpkg"},
        **{name: values for name, values in sections.items() if values},
    }


def _stated(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _step_m(live: LivePlan) -> float:
    """Return the cell of the fine terrain: a metre, more where there would be too many."""
    xmin, ymin, xmax, ymax = _mission_prior(live).bounds
    least = math.sqrt((xmax - xmin) * (ymax - ymin) / _MOST_TERRAIN_CELLS)
    return float(max(1, math.ceil(least)))


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


_ROUTES = (".geojson", ".gpkg")
_AREAS = ("area.gpkg", "area.geojson", "area.kml")
_POINT_FILES = ("points.csv", "points.gpx", "points.gpkg")
_SHEETS = (".pdf", ".qgz")
_MISSIONS = (".plan", ".waypoints")
_OTHERS = (".gpx", ".kml", ".kmz", ".csv", ".wkt")
KINDS: Sequence[str] = (
    *_ROUTES,
    *_OTHERS,
    *_MISSIONS,
    *_SHEETS,
    *_AREAS,
    *_POINT_FILES,
    "sigma.tif",
    "mission.zip",
    "desk.zip",
)
"""Kinds of files, by ending."""
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)


def known_kind(kind: str) -> str:
    """Return a kind of files; refuse one that is not known."""
    if kind not in KINDS:
        raise InputError(
            f"the kind of file {kind[:40]!r} is not known; one of {', '.join(KINDS)} was expected."
        )
    return kind


class MissionOptions(Section):
    """What a mission for an autopilot is made for; the options of ``firnline export``."""

    autopilot: Literal["px4", "ardupilot"] = "px4"
    """Autopilot."""
    speed_m_s: float | None = Field(default=None, gt=0.0, lt=100.0)
    """Speed that the rover is set to [m/s]."""
    returns: bool = False
    """Whether the mission ends with a return to launch."""


_LARGEST_SHARED_BYTES = 32 * 2**20


class ExportedFile(NamedTuple):
    """Name and content of a file; several files are packed into one."""

    name: str
    content: bytes


class PlanExport(NamedTuple):
    """Plan whose files are wanted.

    `live`: the plan, with the covariance of its outline. `document`: from which it was made. `name`: name of
    the plan. `terrain`: raster of the prior. `missions`: options of missions.
    """

    live: LivePlan
    document: PlanDocument
    name: str
    terrain: Path
    missions: MissionOptions = MissionOptions()

    def file(self, kind: str) -> ExportedFile:
        """Return a file of the plan."""
        with tempfile.TemporaryDirectory(prefix="firnline-desk-") as place:
            folder = Path(place)
            self._write(folder, kind)
            files = sorted(file for file in folder.rglob("*") if file.is_file())
            if len(files) == 1:
                return ExportedFile(files[0].name, files[0].read_bytes())
            bare = kind.removesuffix(".zip").strip(".")
            separator = "." if kind == "desk.zip" else "_"
            return ExportedFile(f"{self.name}{separator}{bare}.zip", _packed(folder, files))

    def _write(self, folder: Path, kind: str) -> None:
        plan, place = self.live.plan, folder / f"{self.name}{Path(kind).suffix or kind}"
        if kind in _ROUTES:
            plan.route.write(place)
        elif kind in _AREAS:
            plan.area.write(place.with_stem(f"{self.name}_area"))
        elif kind in _POINT_FILES:
            write_points(self.document, plan.area, plan.prior, place.with_stem(f"{self.name}_points"))
        elif kind in _SHEETS:
            request = request_of(self.document, folder.parent / f"{self.name}_area.gpkg", self.terrain, place)
            write_outputs(request, plan.route, plan.drawing)
        elif kind == "sigma.tif":
            self._write_sigma(folder / f"{self.name}_sigma.tif")
        elif kind == "desk.zip":
            self._write_shared(folder)
        elif kind == "mission.zip":
            write_mission(self.live, self.document, self.name, folder)
        else:
            around = Surroundings(plan.area, _terrain(plan.route, self.terrain), **self.missions.model_dump())
            write_route(plan.route, around, place)

    def _write_shared(self, folder: Path) -> None:
        """Write the plan and its terrain, of a large one what lies about the area, for a desk elsewhere."""
        terrain, prior = folder / f"{self.name}_prior.tif", self.live.plan.prior
        if self.terrain.suffix == terrain.suffix and self.terrain.stat().st_size <= _LARGEST_SHARED_BYTES:
            terrain.write_bytes(self.terrain.read_bytes())
        elif prior is not None:
            prior.write(terrain)
        begun = History.of(self.document.model_copy(update={"measured": {}}), terrain.name)
        StoredHistory(folder / f"{self.name}{SUFFIX}", begun).write()

    def _write_sigma(self, file: Path) -> None:
        drawing = self.live.plan.drawing
        std = drawing.std(self.live.plan.route, drawing.fine_cell_m)
        if std is None:
            reason = self.live.no_error_because
            raise InputError(reason or "no error is predicted for this pattern; choose another one.")
        std.write(file, "sigma_m")


def _terrain(route: Route, terrain: Path) -> Dem | None:
    """Return the prior along the route; None where it does not know the height of every waypoint."""
    places = np.vstack([leg.xy for leg in route.legs])
    bounds = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    prior = read_about(terrain, bounds, route.crs, "the prior")
    return prior if knows_heights(prior, route) else None


def _packed(folder: Path, files: Sequence[Path]) -> bytes:
    """Return files as a zip archive whose bytes depend on their content alone."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _ZIP_DATE)
            archive.writestr(entry, file.read_bytes(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
