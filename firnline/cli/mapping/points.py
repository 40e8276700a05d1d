"""``firnline reconstruct POINTS``: a map from a table of points, from several drives, or from scans and their paths."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from pyproj import CRS

import survey
from firnline.cli.mapping.inputs import MapRequest
from firnline.cli.mapping.outputs import MadeMap
from firnline.cli.progress import counted
from firnline.cli.rasters import own_crs, read_about
from survey.core.errors import InputError
from survey.data.ice_motion import IceMotion, read_motion
from survey.data.sensors.odometry import DriveTies
from survey.interchange.scans import read_sensor_scans
from survey.io.column_names import parse_columns
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reconstruction.line_of_sight.scan_points import BeamErrors, scan_points
from survey.reconstruction.mapping import within
from survey.reconstruction.method import MappedTerrain
from survey.reconstruction.motion.epoch import at_epoch, with_age
from survey.reconstruction.motion.refinement import refined_motion
from survey.reconstruction.observations import (
    Blunders,
    refuse_far_places,
    refuse_feet_among_metres,
    without_blunders,
)
from survey.reconstruction.policy import map_landmarks
from survey.reconstruction.terrain_map import ELEVATION
from vision_slam.fusion.pose_constraints import tie_drives


class PointInputs(NamedTuple):
    """Inputs of a map from points, read and checked."""

    drives: SeveralDrives
    grid: survey.Grid
    area: survey.SurveyArea | None
    paths: list[survey.Trajectory]
    prior: survey.Dem | None
    blunders: dict[str, Blunders]

    @property
    def facts(self) -> dict[str, str]:
        """What was read, for people."""
        rows, columns = self.grid.shape
        left_out = "; ".join(f"{file}: {found.sentence()}" for file, found in self.blunders.items())
        return {
            "points": f"{len(self.drives.points)}, {self.drives.points.crs.name}",
            **({"left out": left_out} if left_out else {}),
            "map": f"{rows} × {columns} nodes of {self.grid.step_m:g} m",
        }


def read_inputs(request: MapRequest) -> PointInputs:
    """Read the points, and with them area, paths and prior, onto the nodes of the map."""
    options = request.options
    blunders: dict[str, Blunders] = {}
    if request.is_registered:
        paths = [_path(file, options.crs) for file in options.trajectories]
        parts = [_registered(request, *each) for each in zip(options.sources, paths, strict=True)]
    else:
        parts = [_sound_points(request, file, blunders) for file in options.sources]
        paths = [_path(file, part.crs) for file, part in zip(options.trajectories, parts, strict=False)]
    errors = [path.error for path in paths] or [None]
    drives = SeveralDrives.of(list(zip(parts, errors, strict=True)))
    if options.ties is not None:
        drives = tie_drives(drives, paths, DriveTies.read(options.ties))
    points = drives.points
    area = request.read_area(points.crs)
    grid = request.grid_over(_bounds(points) if area is None else area.bounds, points.crs)
    prior = None if options.prior is None else _prior(options.prior, grid)
    return PointInputs(drives, grid, area, paths, prior, blunders)


def _sound_points(request: MapRequest, file: Path, blunders: dict[str, Blunders]) -> survey.SurfacePoints:
    """Read points without gross blunders of their heights, which are collected by file; refuse feet and far places."""
    options = request.options
    points = survey.SurfacePoints.read(
        file, crs=options.crs, sigma_m=options.sigma_m, columns=parse_columns(options.columns)
    )
    try:
        if options.area is None:
            refuse_far_places(points)
        if options.value not in (None, ELEVATION):
            return points
        refuse_feet_among_metres(points)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    kept, found = without_blunders(points)
    if len(found.rows):
        blunders[str(file)] = found
    return kept


def map_points(request: MapRequest) -> MadeMap:
    """Map the points of a file, or of several drives, over the area, or over their bounding box."""
    drives, grid, area, paths, prior, blunders = read_inputs(request)
    with counted(quiet=request.options.quiet) as progress:
        mapped = map_landmarks(
            drives.points,
            grid,
            request.config,
            prior=prior,
            path=drives.path,
            quantity=request.options.value or ELEVATION,
            progress=progress,
            area=area,
        )
    moved, motion = _on_ice(mapped, request)
    result = _with_blunders(moved if area is None else within(moved, area), blunders)
    corrected: list[survey.Trajectory] = []
    if mapped.correction is not None:
        parts = drives.corrections(mapped.correction)
        corrected = [part.applied(path) for part, path in zip(parts, paths, strict=True)]
    return MadeMap(result, f"by {request.method.name}", request.options.area, corrected, motion)


def _with_blunders(result: survey.Reconstruction, blunders: dict[str, Blunders]) -> survey.Reconstruction:
    """Return the map with the blunders that were left out in its record."""
    if not blunders:
        return result
    facts = [
        {"file": file, "sentence": found.sentence(), **found.facts()} for file, found in blunders.items()
    ]
    return replace(result, diagnostics={**result.diagnostics, "blunders": facts})


def _on_ice(mapped: MappedTerrain, request: MapRequest) -> tuple[survey.Reconstruction, IceMotion | None]:
    """Return the map with its age at the epoch that was named, and the motion of the ice after the map."""
    file = request.motion_file
    if file is None or mapped.solution is None:
        return mapped.reconstruction, None
    motion = refined_motion(read_motion(file), mapped.solution)
    if request.options.epoch_s is None:
        return with_age(mapped.reconstruction, motion), motion
    return at_epoch(mapped.reconstruction, motion, request.options.epoch_s)


def _prior(file: Path, grid: survey.Grid) -> survey.Dem:
    """Read the prior; of one in degrees, the part about the map, warped to the CRS of the points."""
    if own_crs(file) is None:
        return read_about(file, grid.bounds, grid.crs, "the prior")
    return survey.Dem.read(file)


def _registered(request: MapRequest, source: Path, path: survey.Trajectory) -> survey.SurfacePoints:
    """Return the points that scans become by the path of their drive."""
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
