"""Files of a plan, as ``firnline plan`` and ``firnline export`` write them."""

import io
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from desk.plan.document import PlanDocument
from desk.plan.live import LivePlan
from desk.plan.mission_files import write_mission
from desk.plan.point_files import write_points
from desk.plan.request import request_of
from firnline.cli.planning.outputs import write_plan as write_outputs
from firnline.cli.rasters import read_about
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.route import Route
from survey.interchange.missions import Surroundings
from survey.interchange.route_formats import write_plan

_ROUTES = (".geojson", ".gpkg")
_AREAS = ("area.gpkg", "area.geojson", "area.kml")
_POINTS = ("points.csv", "points.gpx", "points.gpkg")
_SHEETS = (".pdf", ".qgz")
_MISSIONS = (".plan", ".waypoints")
_OTHERS = (".gpx", ".kml", ".kmz", ".csv", ".wkt")
KINDS: Sequence[str] = (
    *_ROUTES,
    *_OTHERS,
    *_MISSIONS,
    *_SHEETS,
    *_AREAS,
    *_POINTS,
    "sigma.tif",
    "mission.zip",
)
"""Kinds of files, by ending."""
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)


class ExportedFile(NamedTuple):
    """Name and content of a file; several files are packed into one."""

    name: str
    content: bytes


class PlanExport(NamedTuple):
    """Plan whose files are wanted.

    `live`: the plan, with the covariance of its outline. `document`: from which it was made. `name`: name of
    the plan. `terrain`: raster of the prior.
    """

    live: LivePlan
    document: PlanDocument
    name: str
    terrain: Path

    def file(self, kind: str) -> ExportedFile:
        """Return a file of the plan."""
        if kind not in KINDS:
            raise InputError(
                f"the kind of file {kind!r} is not known; one of {', '.join(KINDS)} was expected."
            )
        with tempfile.TemporaryDirectory(prefix="firnline-desk-") as place:
            folder = Path(place)
            self._write(folder, kind)
            files = sorted(file for file in folder.rglob("*") if file.is_file())
            if len(files) == 1:
                return ExportedFile(files[0].name, files[0].read_bytes())
            bare = kind.removesuffix(".zip").strip(".")
            return ExportedFile(f"{self.name}_{bare}.zip", _packed(folder, files))

    def _write(self, folder: Path, kind: str) -> None:
        plan, place = self.live.plan, folder / f"{self.name}{Path(kind).suffix or kind}"
        if kind in _ROUTES:
            plan.route.write(place)
        elif kind in _AREAS:
            plan.area.write(place)
        elif kind in _POINTS:
            write_points(self.document, plan.area, plan.prior, place.with_stem(f"{self.name}_points"))
        elif kind in _SHEETS:
            request = request_of(self.document, folder.parent / f"{self.name}.gpkg", self.terrain, place)
            write_outputs(request, plan.route, plan.drawing)
        elif kind == "sigma.tif":
            self._write_sigma(folder / f"{self.name}_sigma.tif")
        elif kind == "mission.zip":
            write_mission(self.live, self.document, self.name, folder)
        else:
            _write_for_others(plan.route, place, Surroundings(plan.area, _terrain(plan.route, self.terrain)))

    def _write_sigma(self, file: Path) -> None:
        drawing = self.live.plan.drawing
        std = drawing.std(self.live.plan.route, drawing.fine_cell_m)
        if std is None:
            reason = self.live.no_error_because
            raise InputError(reason or "no error is predicted for this pattern; choose another one.")
        std.write(file, "sigma_m")


def _write_for_others(route: Route, file: Path, around: Surroundings) -> None:
    """Write one file, or a mission for each rover."""
    if route.n_rovers == 1 or file.suffix not in _MISSIONS:
        write_plan(route, file, around=around)
        return
    for rover in range(route.n_rovers):
        write_plan(route, file.with_stem(f"{file.stem}_rover{rover + 1}"), rover=rover, around=around)


def _terrain(route: Route, terrain: Path) -> Dem | None:
    """Return the prior along the route; None where it does not know the height of every waypoint."""
    places = np.vstack([leg.xy for leg in route.legs])
    bounds = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    prior = read_about(terrain, bounds, route.crs, "the prior")
    return prior if np.isfinite(prior.at(places)).all() else None


def _packed(folder: Path, files: Sequence[Path]) -> bytes:
    """Return files as a zip archive whose bytes depend on their content alone."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _ZIP_DATE)
            archive.writestr(entry, file.read_bytes(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
