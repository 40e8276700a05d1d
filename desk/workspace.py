"""Workspace of the desk: the folder, terrain and plan that a page works on, and how it is opened from files."""

import hashlib
import os
import tempfile
from contextlib import ExitStack
from functools import cached_property
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self
from zipfile import ZipFile

from pyproj import CRS

from desk.jobs.job import Jobs
from desk.plan.document import PlanDocument
from desk.plan.history import History
from desk.plan.history_file import SUFFIX, StoredHistory, read_history
from desk.terrain.pyramid import ElevationPyramid
from desk.terrain.tiles import TerrainTiles
from firnline.actions.interface import own_crs
from survey import Dem, InputError, SurveyArea
from survey.core import CapacityError, refusing_damage, write_bytes
from survey.core.files import existing_file, read_bytes
from survey.core.map_scale import MapScale

if TYPE_CHECKING:
    from desk.plan.live import LivePlanner
    from sim.config.mission import MissionConfig


class Workspace:
    """Everything that one desk works on; close it when the server ends.

    `terrain`: raster of prior elevations. One in degrees is projected for the map as ``firnline plan`` does.
    `plan_file`: file of the plan's history; its folder is the working folder. `first`: document to begin with
    where there is no such file. `opened_run`: run that the desk was opened with. `origin`: source of `first` and its
    checksum, as in `History`; where the source has changed since the plan was drawn, `notice` says so.
    """

    def __init__(
        self,
        terrain: Path,
        plan_file: Path,
        first: PlanDocument,
        opened_run: Path | None = None,
        origin: tuple[str, str] = ("", ""),
    ) -> None:
        self.terrain = terrain
        self.opened_run = opened_run
        self.folder = plan_file.resolve().parent
        self._files = ExitStack()
        projected = terrain if own_crs(terrain) is not None else self._projected(terrain)
        pyramid = self._files.enter_context(ElevationPyramid(projected))
        self.tiles = TerrainTiles(pyramid)
        self.crs: CRS = pyramid.crs
        begun = History.of(first, terrain.name, *origin)
        self.store = StoredHistory(plan_file, begun)
        self.notice = _CHANGED.format(Path(begun.source).name) if self.store.renew(begun) else ""
        self.jobs = Jobs()
        self.n_streams = 0
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


def open_workspace(source: Path | None, folder: Path) -> Workspace:
    """Open what the command names."""
    source = source or _latest_plan(folder)
    if source.suffix == ".zip":
        source = _unpacked(source, folder)
    if source.name.endswith(SUFFIX):
        history = read_history(source)
        return Workspace(source.parent / Path(history.terrain).name, source, history.document)
    if source.is_dir():
        return _of_run(source, folder)
    if source.suffix == ".toml":
        return _of_mission(source, folder)
    return Workspace(source, _plan_file(source.parent / source.stem, source.name), PlanDocument())


_CHANGED = (
    "{} has changed since this plan was drawn from it; its area, prior and settings are shown as they are now. "
    "Undo shows the drawn plan over the new prior."
)


def _plan_file(stem: Path, terrain: str, source: str = "") -> Path:
    """Return the file of the plan that was begun from a source, or a name that is free for a new one."""
    for k in count(1):
        file = stem.with_name(f"{stem.name}{f'-{k}' if k > 1 else ''}{SUFFIX}")
        if not file.exists():
            break
        begun = read_history(file)
        if begun.source == source if begun.source else begun.terrain == terrain:
            break
    return file


_LARGEST_SHARED_BYTES = 512 * 2**20


def _unpacked(source: Path, folder: Path) -> Path:
    """Unpack a plan that was shared into a folder of its name, and return its file; what is there already stays."""
    content = read_bytes(existing_file(source, "the shared plan"), "the shared plan", _LARGEST_SHARED_BYTES)
    place = folder / source.name.removesuffix(".zip").removesuffix(".desk")
    with refusing_damage(str(source), "plan of the desk"), ZipFile(BytesIO(content)) as archive:
        names = archive.namelist()
        (plan,) = (name for name in names if name.endswith(SUFFIX))
        if any(Path(name).name != name for name in names) or len(names) != 2:
            raise ValueError("a plan and its terrain were expected")
        if sum(entry.file_size for entry in archive.infolist()) > _LARGEST_SHARED_BYTES:
            raise CapacityError(
                f"{source} holds more than {_LARGEST_SHARED_BYTES // 2**20} MB; open the plan itself."
            )
        place.mkdir(exist_ok=True)
        for name in names:
            if not (place / name).exists():
                write_bytes(place / name, archive.read(name))
    return place / plan


def _latest_plan(folder: Path) -> Path:
    """Return the plan of a folder that was changed last."""
    plans = sorted(folder.glob(f"*{SUFFIX}"), key=lambda file: file.stat().st_mtime)
    if not plans:
        raise InputError(
            f"the folder {folder} holds no plan of the desk ({SUFFIX}); name a raster of elevations, as in "
            "firnline desk srtm.tif, or try firnline desk --demo."
        )
    return plans[-1]


def _of_mission(source: Path, folder: Path) -> Workspace:
    from sim.mission.runs import read_mission
    from sim.world.site import build_world

    mission = read_mission(source)
    world = build_world(mission)
    return _workspace(mission, world.area, world.prior, folder, source)


def _of_run(source: Path, folder: Path) -> Workspace:
    from sim.mission.runs import read_mission
    from survey import Dem, SurveyArea
    from survey.core.run_folder import RunFolder

    run = RunFolder.find(source)
    stage = run.verified("plan")
    mission = read_mission(run.path / "config.toml")
    area, prior = SurveyArea.read(stage / "area.gpkg"), Dem.read(stage / "prior.tif")
    return _workspace(mission, area, prior, folder, run.path)


def _workspace(
    mission: "MissionConfig", area: "SurveyArea", prior: "Dem", folder: Path, source: Path
) -> Workspace:
    """Store the prior of a mission in the current folder, and open it with the mission's settings.

    The name of the prior holds its checksum, so that a prior that has changed is another file.
    """
    document = _document(mission, area)
    prior_sha256 = _sha256(prior.elevation.tobytes(), prior.transform, prior.crs.to_wkt())
    terrain = folder / f"{mission.name}_prior-{prior_sha256[:8]}.tif"
    if not terrain.exists():
        prior.write(terrain)
    place = os.path.relpath(source.resolve(), folder.resolve())
    plan_file = _plan_file(folder / mission.name, f"{mission.name}_prior.tif", place)
    return Workspace(
        terrain,
        plan_file,
        document,
        source if source.is_dir() else None,
        (place, _sha256(prior_sha256, document.model_dump_json())),
    )


def _sha256(*parts: Any) -> str:
    contents = (part if isinstance(part, bytes) else str(part).encode() for part in parts)
    return hashlib.sha256(b"\n".join(contents)).hexdigest()


def _document(mission: "MissionConfig", area: "SurveyArea") -> PlanDocument:
    """Return the survey of a mission, with the settings that differ from their defaults."""
    from planners.routes.rover import Rover

    planner = mission.planner.model_dump(mode="json", exclude_defaults=True)
    rover = mission.rover.model_dump(mode="json", exclude_defaults=True, include=set(Rover.model_fields))
    return PlanDocument.of_area(
        area,
        planner={**planner, "pattern": mission.planner.pattern},
        rover=rover,
        fleet=mission.fleet.model_dump(mode="json", exclude_defaults=True),
    )


_NAME = "srtm_sample"


def write_demo(folder: Path) -> Path:
    """Write the sample terrain and a plan to begin with; what is there already stays."""
    from survey.terrain.real import real_sample, sample_site

    folder.mkdir(parents=True, exist_ok=True)
    terrain, plan_file = folder / f"{_NAME}.tif", folder / f"{_NAME}{SUFFIX}"
    if not terrain.exists():
        real_sample().write(terrain)
    if not plan_file.exists():
        site = sample_site()
        west, south, east, north = (round(limit, -1) for limit in site.bounds)
        bounds = (west - 200.0, south - 200.0, east + 200.0, north + 200.0)
        area = SurveyArea.rectangle(bounds, site.prior.crs)
        document = PlanDocument.of_area(area).model_copy(update={"starts": ((west - 150.0, south - 150.0),)})
        StoredHistory(plan_file, History.of(document, terrain.name)).write()
    return plan_file
