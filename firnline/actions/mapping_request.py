"""Request of a map: options and settings, checked against what the method needs."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pyproj import CRS

import survey
from firnline.actions.interface import area_if_named
from firnline.actions.requests import ReconstructRequest
from survey.core import InputError, Section, projected_crs, validated, with_overrides
from survey.data.ice_motion import ICE_MOTION
from survey.interchange.scans import SensorPath, holds_sensor_scans, read_scans, scan_files
from survey.io.column_names import parse_columns
from survey.io.point_files import TABLES
from survey.reconstruction.capacity import require_nodes
from survey.reconstruction.method import ReconstructionMethod, ScanSettings
from survey.reconstruction.registry import METHODS, ReconstructionConfig, method_named, names_where
from survey.reconstruction.terrain_map import ELEVATION
from vision_slam.readers.gps_files import is_receiver_log

_STEP_M, _SCAN_STEP_M = 1.0, 0.25


class _Settings(Section):
    reconstruction: ReconstructionConfig


@dataclass(frozen=True)
class MapRequest:
    """Request that was checked, with the method, its settings and the distance between nodes that follow from it."""

    options: ReconstructRequest
    method: ReconstructionMethod
    config: ReconstructionConfig
    step_m: float

    @property
    def is_of_scans(self) -> bool:
        """Whether the sources are scans that are mapped one by one, and not one table of points."""
        return _are_scans(self.options, self.method)

    @property
    def is_registered(self) -> bool:
        """Whether the sources are scans that become points by paths of known error."""
        return _are_registered(self.options)

    @property
    def is_of_fixes(self) -> bool:
        """Whether the sources are logs of receivers, whose fixes lie on their own path."""
        return are_fixes(self.options.sources)

    @property
    def compares_strips(self) -> bool:
        """Whether the sources are heights of points whose errors nothing else estimates, so that strips among them are compared."""
        is_of_points = not (self.is_of_scans or self.is_registered or self.is_of_fixes)
        return is_of_points and not self.method.needs_path and self.options.value in (None, ELEVATION)

    @property
    def leaves_method_open(self) -> bool:
        """Whether neither a method nor anything that only some methods use was stated."""
        return self.options.prior is None and not {"method", "gp", "rays"} & self.config.model_fields_set

    def by(self, method: str) -> "MapRequest":
        """Return the request with a method."""
        return replace(
            self, method=method_named(method), config=self.config.model_copy(update={"method": method})
        )

    @property
    def motion_file(self) -> Path | None:
        """Motion of the ice beside the trajectory of a single drive; None where the ground rests."""
        paths = self.options.trajectories
        file = paths[0].with_name(ICE_MOTION) if self.method.needs_path and len(paths) == 1 else None
        return file if file is not None and file.exists() else None

    @property
    def inputs(self) -> list[Path | None]:
        """Every file and folder that is read."""
        options = self.options
        return [*options.sources, options.prior, options.area, options.ties, *options.trajectories]

    @property
    def scan_files(self) -> list[Path]:
        """Files of the scans, in their order."""
        return scan_files(self.options.sources)

    @property
    def scan_settings(self) -> ScanSettings:
        """Settings of a map from scans."""
        config = self.config
        return ScanSettings(self.step_m, rays=config.rays, configs=config.configs_of(self.method))

    def read_scans(self) -> Iterator[survey.SurfacePoints]:
        """Read the scans one after the other, with the poses of the scanner where a file states them."""
        options = self.options
        track = next((SensorPath.read(file) for file in options.trajectories), None)
        return read_scans(
            self.scan_files, crs=options.crs, sigma_m=options.sigma_m, track=track, units=options.units
        )

    def area_of_scans(self) -> survey.SurveyArea | None:
        """Return the area to map; scans state their CRS one by one, so that --crs or the area's own counts."""
        options = self.options
        if options.crs is not None and options.area is not None:
            return self.read_area(projected_crs(options.crs, "the scans"))
        area = area_if_named(options.area, options, None)
        if area is not None and not area.crs.is_projected:
            raise InputError(f"{options.area} is in degrees; add --crs with the CRS of the scans.")
        return area

    def at(self, out: Path) -> "MapRequest":
        """Return the request with another place of the map."""
        return replace(self, options=replace(self.options, out=out))

    def read_area(self, crs: CRS) -> survey.SurveyArea | None:
        """Return the area to map, in the points' CRS."""
        area = area_if_named(self.options.area, self.options, crs)
        if area is not None:
            area.require_crs(crs, "the points")
        return area

    def grid_over(self, bounds: tuple[float, float, float, float], crs: CRS) -> survey.Grid:
        """Return the nodes over bounds [m], or refuse more of them than fit into memory."""
        self.method.require_room(bounds, self.step_m, self.config.configs_of(self.method))
        return survey.Grid.over(bounds, self.step_m, crs)


def map_request(options: ReconstructRequest) -> MapRequest:
    """Return the checked request."""
    _refuse_options_of_others(options)
    if options.method is not None:
        method_named(options.method)
    if options.step_m is not None:
        require_nodes((0.0, 0.0, 0.0, 0.0), options.step_m, 0.0)
    config = _config(options)
    chosen = method_named(config.method)
    default_m = _SCAN_STEP_M if _are_scans(options, chosen) else _STEP_M
    is_stated = "grid_step_m" in config.model_fields_set
    request = MapRequest(options, chosen, config, config.grid_step_m if is_stated else default_m)
    if options.product is not None and options.prior is None:
        raise InputError(
            "--product names the class of a prior; add --prior with its file, or leave --product out."
        )
    parse_columns(options.columns, layout=options.layout)
    _refuse_unused(request)
    if options.epoch_s is not None and request.motion_file is None:
        raise InputError(
            f"--epoch moves a map with the ice, and no {ICE_MOTION} stands beside a trajectory of the method joint; localize with "
            "--epoch first, or leave it out."
        )
    return request


def _refuse_options_of_others(options: ReconstructRequest) -> None:
    """Refuse options of maps in tiles, and a slope without lines of sight."""
    given = {"--workers": options.workers, "--scheduler": options.scheduler, "--control": options.control}
    for name, value in given.items():
        if value is not None:
            raise InputError(f"{name} is of maps in tiles; add --tiles, or leave {name} out.")
    if options.max_slope_deg is not None and not options.rays:
        raise InputError("steep ground is found from the map's bounds; add --rays to --max-slope.")


def _config(options: ReconstructRequest) -> ReconstructionConfig:
    """Return the settings that options and overrides state."""
    given = {"method": options.method, "grid_step_m": options.step_m, "rays": options.rays or None}
    values = {"reconstruction": {key: value for key, value in given.items() if value is not None}}
    settings = options.settings
    if options.product is not None:
        settings = [f"reconstruction.joint.satellite.product={options.product}", *settings]
    return validated(_Settings, with_overrides(values, settings), "--set").reconstruction


def _are_scans(options: ReconstructRequest, method: ReconstructionMethod) -> bool:
    sources = options.sources
    if method.begin is None or _are_registered(options) or are_fixes(sources):
        return False
    return len(sources) > 1 or sources[0].suffix.lower() not in TABLES


_AUTOPILOTS = (".tlog", ".ulg")


def are_fixes(sources: list[Path]) -> bool:
    """Return whether all sources are logs of receivers or autopilots; refuse such logs beside points."""
    is_log = [file.suffix.lower() in _AUTOPILOTS or is_receiver_log(file) for file in sources]
    if any(is_log) and not all(is_log):
        log, points = sources[is_log.index(True)], sources[is_log.index(False)]
        raise InputError(f"{log} is the log of a receiver and {points} is none; map them apart.")
    return all(is_log)


def _are_registered(options: ReconstructRequest) -> bool:
    """Return whether scans in the frame of their sensor come with tables of poses, which have covariances."""
    has_tables = bool(options.trajectories) and all(file.suffix == ".csv" for file in options.trajectories)
    return has_tables and all(holds_sensor_scans(source) for source in options.sources)


def _refuse_unused(request: MapRequest) -> None:
    """Refuse options that the method does not use, and name the methods that do."""
    method = request.method
    has_paths = method.needs_path or request.is_registered or request.is_of_fixes
    is_single = method.begin is None and not has_paths
    if len(request.options.sources) > 1 and is_single:
        raise InputError(
            f"{len(request.options.sources)} files were named, and the method {method.name!r} maps one; name one, or take "
            f"{names_where(m for m in METHODS.values() if m.begin or m.needs_path)}."
        )
    if request.options.prior is not None and not method.uses_prior:
        raise InputError(
            f"the method {method.name} uses no prior; leave --prior out, or take "
            f"{names_where(m for m in METHODS.values() if m.uses_prior)}."
        )
    named = request.options.columns or request.options.layout
    if named and (request.is_of_scans or request.is_registered):
        raise InputError(
            "--columns and --format choose columns of tables of points, and scans have none; leave them out."
        )
    if request.options.adjust_strips and (not request.compares_strips or request.config.rays):
        raise InputError(
            "--adjust-strips moves points of the ground in one file before they are mapped, and neither scans, paths, lines of sight nor "
            "other values go with that; leave it out."
        )
    _refuse_paths(request)
    if request.options.ties is not None and len(request.options.trajectories) < 2:
        raise InputError(
            "--ties names places that two drives share, and there are not two; name the points and the trajectory of each "
            "drive, or leave --ties out."
        )
    if request.config.rays and method.sight_lines == "none":
        raise InputError(
            f"the method {method.name} uses no lines of sight; take field or carving, or leave --rays out."
        )


def _refuse_paths(request: MapRequest) -> None:
    """Refuse paths that the method does not use, and another number of them than it needs."""
    method, n = request.method, len(request.options.trajectories)
    if request.is_of_fixes:
        if n:
            raise InputError(
                f"{request.options.sources[0]} is a log of fixes, which are a path themselves; leave --trajectory out."
            )
        return
    if request.options.antenna_m is not None:
        raise InputError(
            f"--antenna is of logs of receivers, and {request.options.sources[0]} is none; leave it out."
        )
    if n and not (method.needs_path or request.is_of_scans or request.is_registered):
        _refuse_sources_without_scans(request.options.sources)
        raise InputError(
            f"the method {method.name} does not use a trajectory; take --method joint, or leave --trajectory out."
        )
    if request.is_of_scans and n > 1:
        raise InputError(f"{n} trajectories were named for scans; name the one of the scanner.")
    if method.needs_path and n == 0:
        raise InputError(
            "the method joint needs the path that the points were seen from; add --trajectory trajectory.csv, with "
            "trajectory.error.npz beside it."
        )
    if (method.needs_path or request.is_registered) and n != len(request.options.sources):
        raise InputError(
            f"{len(request.options.sources)} sources of points and {n} trajectories were named; name one --trajectory for "
            "each of them, in their order."
        )


def _refuse_sources_without_scans(sources: list[Path]) -> None:
    """Refuse a source that is missing, or a folder that was named for its scans and holds none."""
    for source in sources:
        if not source.exists():
            raise InputError(f"the points or scans {source} do not exist; check the path.")
        if source.is_dir():
            raise InputError(
                f"the folder {source} holds no scans; name a recording with a LiDAR, a KITTI drive or a ROS 2 bag."
            )
