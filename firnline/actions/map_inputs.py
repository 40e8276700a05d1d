"""Inputs of a map from points, read and checked: points, registered scans, paths, ties, area and prior."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pyproj import CRS

import survey
from firnline.actions.interface import own_crs, read_about
from firnline.actions.localizing import LocalizeRequest
from firnline.actions.mapping_request import MapRequest
from survey.core import InputError
from survey.data.sensors.odometry import DriveTies
from survey.interchange.scans import read_sensor_scans
from survey.io.column_names import parse_columns
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reconstruction.observations import SoundPoints, sound_points
from survey.reconstruction.terrain_map import ELEVATION, STRIP_NAMES
from vision_slam.config import LocalizationConfig

if TYPE_CHECKING:
    from survey.reconstruction.strip_adjustment import StripAdjustment


def blunder_text(found: Mapping[str, Any]) -> str:
    """Return the sentence about blunders that were left out, with the file or the number of the scan that holds them."""
    scan = f"scan {found['scan']}" if "scan" in found else None
    place = found.get("file", scan)
    return f"{place}: {found['sentence']}" if place else str(found["sentence"])


_APART = (
    "the points share the error of their path, and this map takes it as a new one at each point, so that σ is too small; "
    "name --trajectory trajectory.csv and --method joint"
)


class PointInputs(NamedTuple):
    """Inputs of a map from points, read and checked."""

    drives: SeveralDrives
    grid: survey.Grid
    area: survey.SurveyArea | None
    paths: list[survey.Trajectory]
    prior: survey.Dem | None
    blunders: tuple[dict[str, Any], ...]
    notes: tuple[str, ...] = ()
    strips: "StripAdjustment | None" = None

    @property
    def facts(self) -> dict[str, str]:
        """What was read, for people."""
        rows, columns = self.grid.shape
        left_out = "; ".join(blunder_text(found) for found in self.blunders)
        return {
            "points": f"{len(self.drives.points)}, {self.drives.points.crs.name}",
            **({"left out": left_out} if left_out else {}),
            "map": f"{rows} × {columns} nodes of {self.grid.step_m:g} m",
        }


def read_points(request: MapRequest) -> PointInputs:
    """Read the points, and with them area, paths and prior, onto the nodes of the map."""
    options = request.options
    notes: tuple[str, ...] = ()
    if request.is_registered:
        paths = [_path(file, options.crs) for file in options.trajectories]
        scans = [_registered(request, *each) for each in zip(options.sources, paths, strict=True)]
        sound = [
            sound_points(seen, has_area=options.area is not None, file=str(file))
            for seen, file in zip(scans, options.sources, strict=True)
        ]
        parts = [each.points for each in sound]
    elif request.is_of_fixes:
        found = [_ground_below(request, file) for file in options.sources]
        paths = [each.path for each in found]
        notes = tuple(note for each in found for note in each.notes)
        sound = [
            sound_points(each.points, has_area=options.area is not None, file=str(file))
            for each, file in zip(found, options.sources, strict=True)
        ]
        parts = [each.points for each in sound]
    else:
        read = [_noted_points(request, file) for file in options.sources]
        sound, notes = [each for each, _ in read], tuple(note for _, each in read for note in each)
        parts = [each.points for each in sound]
        paths = [_path(file, part.crs) for file, part in zip(options.trajectories, parts, strict=False)]
    errors = [path.error for path in paths] or [None]
    drives = SeveralDrives.of(list(zip(parts, errors, strict=True)))
    if options.ties is not None:
        from vision_slam.fusion.pose_constraints import tie_drives

        drives = tie_drives(drives, paths, DriveTies.read(options.ties))
    strips = _compared(drives.points, options.sources[0], request) if request.compares_strips else None
    if strips is not None and options.adjust_strips:
        drives = drives._replace(points=strips.adjusted(drives.points))
    points = drives.points
    if points.keyframe is not None and drives.path is None:
        notes += (_APART,)
    area = request.read_area(points.crs)
    grid = request.grid_over(_bounds(points) if area is None else area.bounds, points.crs)
    prior = None if options.prior is None else _prior(options.prior, grid, options.units)
    blunders = tuple(found for each in sound for found in each.blunders)
    return PointInputs(drives, grid, area, paths, prior, blunders, notes, strips)


def _compared(points: survey.SurfacePoints, file: Path, request: MapRequest) -> "StripAdjustment | None":
    """Return what the overlaps of strips show; where they are to be adjusted, refuse points that do not name several."""
    strips: StripAdjustment | None = None
    if any(name in points.values for name in STRIP_NAMES):
        from survey.reconstruction.strip_adjustment import compare_strips  # loads compiled code

        strips = compare_strips(points)
    if strips is None and request.options.adjust_strips:
        raise InputError(
            f"{file} does not name several strips (a point source of LAS or LAZ, or whole numbers in a column strip); leave --adjust-strips out."
        )
    return strips


def _noted_points(request: MapRequest, file: Path) -> tuple[SoundPoints, tuple[str, ...]]:
    """Read points without gross blunders of their heights, and what is to be known of them; refuse feet, and far places where no area is named."""
    options = request.options
    points, notes = survey.SurfacePoints.read_noted(
        file,
        crs=options.crs,
        sigma_m=options.sigma_m,
        columns=parse_columns(options.columns, layout=options.layout),
        units=options.units,
        ground=options.ground,
    )
    sound = sound_points(
        points, options.value or ELEVATION, has_area=options.area is not None, file=str(file)
    )
    return sound, notes


class _Ground(NamedTuple):
    """Ground below the antenna of a receiver, the path with the error that its fixes share, and what their reader notes."""

    points: survey.SurfacePoints
    path: survey.Trajectory
    notes: tuple[str, ...]


def _ground_below(request: MapRequest, file: Path) -> _Ground:
    """Return the ground below the antenna of the receiver whose log a file is."""
    options = request.options
    drive = LocalizeRequest(
        source=file, crs=options.crs, columns=options.columns, antenna_m=options.antenna_m
    ).open()
    if drive.no_ground:
        raise InputError(f"{file} gives no points of the ground: {drive.no_ground}.")
    records = drive.records
    assert isinstance(records, survey.Recording)
    gps = records.gps
    if gps.sigma_m is None and options.sigma_m is None:
        raise InputError(
            f"{file} states no errors of its fixes; give the standard deviation of their heights [m] with --sigma."
        )
    if gps.sigma_m is None and options.sigma_m is not None:
        upward = np.full(len(gps), options.sigma_m)
        gps = replace(gps, sigma_m=upward / LocalizationConfig().gps_vertical_factor, sigma_z_m=upward)
    found = replace(drive, records=replace(records, gps=gps)).localize()
    assert found.points is not None
    assert found.trajectory is not None
    return _Ground(found.points, found.trajectory, tuple(f"{file}: {note}" for note in drive.notes))


def _prior(file: Path, grid: survey.Grid, units: str | None) -> survey.Dem:
    """Read the prior; of one in degrees, the part about the map, warped to the CRS of the points."""
    if own_crs(file) is None:
        return read_about(file, grid.bounds, grid.crs, "the prior", units=units)
    return survey.Dem.read(file, units=units)


def _registered(request: MapRequest, source: Path, path: survey.Trajectory) -> survey.SurfacePoints:
    """Return the points that scans become by the path of their drive."""
    from survey.reconstruction.line_of_sight.scan_points import BeamErrors, scan_points

    found = read_sensor_scans(source, path.time_s, request.options.sigma_m)
    errors = BeamErrors(found.range_sigma_m, found.angle_sigma_deg)
    return scan_points(found.scans, path, errors, config=request.config.scans)


def _path(file: Path, crs: CRS | str | None) -> survey.Trajectory:
    """Read the path, and refuse one without its error."""
    if crs is None:
        raise InputError(f"the trajectory {file} names no CRS; give it with --crs.")
    path = survey.Trajectory.read(file, crs)
    if path.error is None:
        expected = file.with_suffix(".error.npz")
        raise InputError(
            f"{file} has no error of the path beside it ({expected.name} was expected, of a trajectory.csv that "
            "localize wrote); copy it there, or take the method gp."
        )
    return path


def _bounds(points: survey.SurfacePoints) -> tuple[float, float, float, float]:
    (xmin, ymin), (xmax, ymax) = points.xy.min(axis=0), points.xy.max(axis=0)
    return float(xmin), float(ymin), float(xmax), float(ymax)
