"""``firnline reconstruct POINTS``: a map from a table of points, or a joint map from the tables of several drives."""

from pathlib import Path
from typing import NamedTuple

import survey
from sim.cli.mapping.inputs import MapRequest
from sim.cli.mapping.outputs import MadeMap
from sim.cli.progress import counted
from sim.cli.rasters import own_crs, read_about
from survey.core.errors import InputError
from survey.reconstruction.base import ELEVATION
from survey.reconstruction.joint.several_drives import SeveralDrives
from survey.reconstruction.mapping import within
from survey.reconstruction.policy import map_landmarks


class PointInputs(NamedTuple):
    """Inputs of a map from points, read and checked."""

    drives: SeveralDrives
    grid: survey.Grid
    area: survey.SurveyArea | None
    paths: list[survey.Trajectory]
    prior: survey.Dem | None

    @property
    def facts(self) -> dict[str, str]:
        """What was read, for people."""
        rows, columns = self.grid.shape
        return {
            "points": f"{len(self.drives.points)}, {self.drives.points.crs.name}",
            "map": f"{rows} × {columns} nodes of {self.grid.step_m:g} m",
        }


def read_inputs(request: MapRequest) -> PointInputs:
    """Read the points, and with them area, paths and prior, onto the nodes of the map."""
    options = request.options
    parts = [
        survey.SurfacePoints.read(file, crs=options.crs, sigma_m=options.sigma_m) for file in options.sources
    ]
    paths = [_path(file, part) for file, part in zip(options.trajectories, parts, strict=False)]
    errors = [path.error for path in paths] or [None]
    drives = SeveralDrives.of(list(zip(parts, errors, strict=True)))
    points = drives.points
    area = request.read_area(points.crs)
    grid = request.grid_over(_bounds(points) if area is None else area.bounds, points.crs)
    prior = None if options.prior is None else _prior(options.prior, grid)
    return PointInputs(drives, grid, area, paths, prior)


def map_points(request: MapRequest) -> MadeMap:
    """Map the points of a file, or of several drives, over the area, or over their bounding box."""
    drives, grid, area, paths, prior = read_inputs(request)
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
    result = mapped.reconstruction if area is None else within(mapped.reconstruction, area)
    corrected: list[survey.Trajectory] = []
    if mapped.correction is not None:
        parts = drives.corrections(mapped.correction)
        corrected = [part.applied(path) for part, path in zip(parts, paths, strict=True)]
    return MadeMap(result, f"by {request.method.name}", request.options.area, corrected)


def _prior(file: Path, grid: survey.Grid) -> survey.Dem:
    """Read the prior; of one in degrees, the part about the map, warped to the CRS of the points."""
    if own_crs(file) is None:
        return read_about(file, grid.bounds, grid.crs, "the prior")
    return survey.Dem.read(file)


def _path(file: Path, points: survey.SurfacePoints) -> survey.Trajectory:
    """Read the path, and refuse one without its error."""
    path = survey.Trajectory.read(file, points.crs)
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
