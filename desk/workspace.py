"""Workspace of the desk: a terrain, the plan that is drawn on it, and the folder in which files are written."""

import tempfile
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

from pyproj import CRS

from desk.jobs.job import Jobs
from desk.plan.document import PlanDocument
from desk.plan.history import SUFFIX, StoredHistory
from desk.terrain.pyramid import ElevationPyramid
from desk.terrain.tiles import TerrainTiles
from firnline.actions.interface import own_crs
from survey.core.map_scale import MapScale
from survey.data.dem import Dem

if TYPE_CHECKING:
    from desk.plan.live import LivePlanner


class Workspace:
    """Everything that one desk works on; close it when the server ends.

    `terrain`: raster of prior elevations. One in degrees is projected for the map as ``firnline plan`` does.
    `plan_file`: file of the plan's history; its folder is the working folder. `first`: document to begin with
    where there is no such file. `opened_run`: run that the desk was opened with.
    """

    def __init__(
        self, terrain: Path, plan_file: Path, first: PlanDocument, opened_run: Path | None = None
    ) -> None:
        self.terrain = terrain
        self.opened_run = opened_run
        self.folder = plan_file.resolve().parent
        self._files = ExitStack()
        projected = terrain if own_crs(terrain) is not None else self._projected(terrain)
        pyramid = self._files.enter_context(ElevationPyramid(projected))
        self.tiles = TerrainTiles(pyramid)
        self.crs: CRS = pyramid.crs
        self.store = StoredHistory(plan_file, terrain.name, first)
        self.jobs = Jobs()
        self.map_scale = MapScale.over(self.crs, pyramid.bounds).linear.mean

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.jobs.cancel_all()
        self._files.close()

    @cached_property
    def planner(self) -> "LivePlanner":
        """Planner of the documents; its packages take seconds to load, and are loaded when it is first used."""
        from desk.plan.live import LivePlanner

        return LivePlanner(self.terrain, self.crs)

    @property
    def name(self) -> str:
        """Name of the plan: that of its file without endings."""
        return self.store.path.name.removesuffix(SUFFIX)

    @property
    def measurements(self) -> Path:
        """Folder of the plan's real measurements."""
        return self.folder / f"{self.name}_measured"

    def measured_file(self, role: Literal["points", "checkpoints", "driven"]) -> Path | None:
        """Return a file of real measurements; None where none was taken."""
        name = self.store.document.measured.get(role)
        return None if name is None else self.measurements / name

    def _projected(self, terrain: Path) -> Path:
        """Write a raster in degrees as a projected one, for the map."""
        folder = self._files.enter_context(tempfile.TemporaryDirectory(prefix="firnline-desk-"))
        place = Path(folder) / "terrain.tif"
        Dem.read(terrain).write(place)
        return place
