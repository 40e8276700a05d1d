"""Map terrain from points, from several drives, or from LiDAR scans.

The inputs are read and checked, the map is made, and its folder is written.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import typer
from pyproj import CRS

import survey
from firnline.actions.files import own_crs, read_about
from firnline.actions.interface import fact_line, figure_lines
from firnline.actions.mapping_request import MapRequest
from firnline.cli.progress import counted
from survey.core.crs.checks import projected_crs
from survey.core.errors import InputError
from survey.core.files.replacing import replacing_folder
from survey.data.ice.motion import IceMotion
from survey.data.ice.motion_file import ICE_MOTION, read_motion, write_motion
from survey.data.sensors.drive_ties import DriveTies
from survey.interchange.scans import SensorPath, read_scans, scan_files
from survey.interchange.sensor_scans import read_sensor_scans
from survey.io.text_tables.spellings import parsed_columns
from survey.reconstruction.base import ELEVATION
from survey.reconstruction.beyond_points import beyond_sentences
from survey.reconstruction.checks.blunders import (
    Blunders,
    refuse_far_places,
    refuse_feet_among_metres,
    without_blunders,
)
from survey.reconstruction.joint.several_drives import SeveralDrives
from survey.reconstruction.mapping import within
from survey.reconstruction.method import MappedTerrain, ScanSettings
from survey.reconstruction.motion.epoch import at_epoch, with_age
from survey.reconstruction.motion.refinement import refined_motion
from survey.reconstruction.policy import map_landmarks
from survey.reconstruction.registration.scan_points import BeamErrors, scan_points
from survey.reconstruction.scan_map import map_scans
from vision_slam.fusion.drive_ties import tie_drives

OWN_FILES = (
    *("dem.tif", "support.tif", "bounds.tif", "no_go.tif", "reconstruction.json"),
    *("mean.png", "sigma.png", "width.png", "support.png"),
    ICE_MOTION,
    *("corrected_trajectory*.csv", "corrected_trajectory*.error.npz", "*.aux.xml"),
)
"""Patterns of the files that a reconstruction consists of."""
_BOUNDING_BOX = "bounding box of the points"
_MOST_DRAWN_NODES = 4_000_000


class MadeMap(NamedTuple):
    """A map, how it was made, the area that was named, the corrected path of each drive of a joint map, and the ice's motion."""

    reconstruction: survey.Reconstruction
    origin: str
    area: Path | None = None
    corrected: Sequence[survey.Trajectory] = ()
    motion: IceMotion | None = None


def write_map(made: MadeMap, out: Path, *, rays: bool, max_slope_deg: float | None) -> None:
    """Write the map into a new folder that replaces the old one when it is complete."""
    with replacing_folder(out, own=OWN_FILES) as draft:
        _with_area(made).write(draft)
        for k, path in enumerate(made.corrected, 1):
            number = "" if len(made.corrected) == 1 else f"_{k}"
            path.write(draft / f"corrected_trajectory{number}.csv")
        if made.motion is not None:
            write_motion(made.motion, draft / ICE_MOTION)
        _draw(made.reconstruction, draft)
        if rays:
            _mark(made.reconstruction, draft, max_slope_deg)


def _with_area(made: MadeMap) -> survey.Reconstruction:
    """Return the map with the area that it covers in its record."""
    diagnostics = {**made.reconstruction.diagnostics, "area": _area_text(made.area)}
    return replace(made.reconstruction, diagnostics=diagnostics)


def _area_text(area: Path | None) -> str:
    return _BOUNDING_BOX if area is None else str(area)


def _draw(result: survey.Reconstruction, out: Path) -> None:
    """Write pictures of mean, standard deviation and support; large maps have none, and a log entry says so."""
    from survey.figures import deviation_map, png_bytes, support_map, survey_map

    if result.quantity != ELEVATION:
        return
    if result.support.size > _MOST_DRAWN_NODES:
        logging.getLogger(__name__).warning(
            "the map has %s nodes; pictures are drawn of up to %s.",
            f"{result.support.size:,}",
            f"{_MOST_DRAWN_NODES:,}",
        )
        return
    figures = {
        "mean": survey_map(result.mean),
        "sigma": deviation_map(result),
        "support": support_map(result),
    }
    for name, figure in figures.items():
        (out / f"{name}.png").write_bytes(png_bytes(figure))


def _mark(result: survey.Reconstruction, out: Path, max_slope_deg: float | None) -> None:
    """Write a picture of the width between the bounds, and the ground that is certainly too steep."""
    from survey.figures import png_bytes
    from survey.figures.bounds import width_map
    from survey.reconstruction.line_of_sight.steep_ground import steep_ground

    if result.lower is None or result.upper is None:
        return
    (out / "width.png").write_bytes(png_bytes(width_map(result)))
    if max_slope_deg is not None:
        steep_ground(result, max_slope_deg).write(out / "no_go.tif")


def print_map(made: MadeMap, out: Path, *, as_json: bool) -> None:
    """Print what was made, for people or as JSON."""
    if as_json:
        typer.echo((out / "reconstruction.json").read_text(encoding="utf-8"))
        return
    result = made.reconstruction
    rows, columns = result.mean.shape
    typer.echo(f"{rows} × {columns} nodes {made.origin}, written to {out / 'dem.tif'}")
    hint = " (name a polygon with --area)" if made.area is None else ""
    typer.echo(fact_line("area", f"{_area_text(made.area)}{hint}"))
    for line in figure_lines(result.hyperparameters):
        typer.echo(line)
    _print_findings(result)
    if result.quantity == ELEVATION:
        typer.echo(
            fact_line(
                "next", f"firnline score {out / 'dem.tif'} --truth REFERENCE, or --checkpoints POINTS.csv"
            )
        )


def _print_findings(result: survey.Reconstruction) -> None:
    """Print the check by points left out, the classes by the map's claim, and what is to be known of the input."""
    from survey.scoring.standards.certificate import own_claim

    for sentence in own_claim(result) if result.quantity == ELEVATION else beyond_sentences(result):
        typer.echo(fact_line("map", sentence))
    if result.method == "tin":
        typer.echo(
            fact_line(
                "map", "σ is that of the points alone, without the relief between them; no class is stated."
            )
        )
    share = result.diagnostics.get("prior_covered_share")
    if share is not None:
        typer.echo(fact_line("prior", f"covers {100.0 * share:.1f} % of the map; the rest has no height"))
    for found in result.diagnostics.get("blunders", ()):
        typer.echo(fact_line("left out", f"{found['file']}: {found['sentence']}"))
    n_low = result.diagnostics.get("n_low_returns", 0)
    if n_low:
        typer.echo(fact_line("left out", f"{n_low} isolated low returns"))
    offset_m = result.diagnostics.get("satellite_offset_m")
    if offset_m is not None:
        sigma_m = result.diagnostics["satellite_offset_m_sigma"]
        typer.echo(fact_line("prior", f"lies {offset_m:+.2f} ± {sigma_m:.2f} m from the map"))
    for conflict in result.diagnostics.get("prior_conflicts", ()):
        typer.echo(fact_line("warning", conflict))


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
        file, crs=options.crs, sigma_m=options.sigma_m, columns=parsed_columns(options.columns)
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


def map_scan_files(request: MapRequest) -> MadeMap:
    """Map scans as they are read, over the area or over all that they show."""
    files = scan_files(request.options.sources)
    track = next((SensorPath.read(file) for file in request.options.trajectories), None)
    area = _area_of_scans(request)
    grid = None if area is None else request.grid_over(area.bounds, area.crs)
    config = request.config
    settings = ScanSettings(request.step_m, rays=config.rays, configs=config.configs_of(request.method))
    with counted(quiet=request.options.quiet) as progress:
        made = map_scans(
            read_scans(files, crs=request.options.crs, sigma_m=request.options.sigma_m, track=track),
            request.method,
            settings,
            grid=grid,
            on_scan=lambda n: progress("scans", n, max(len(files), n)),
        )
    result = made.reconstruction if area is None else within(made.reconstruction, area)
    return MadeMap(result, f"from {made.n_scans} scans", request.options.area)


def _area_of_scans(request: MapRequest) -> survey.SurveyArea | None:
    """Return the area to map; scans state their CRS one by one, so that --crs or the area's own counts."""
    if request.options.area is None:
        return None
    if request.options.crs is None:
        area = survey.SurveyArea.read(request.options.area)
        if not area.crs.is_projected:
            raise InputError(f"{request.options.area} is in degrees; add --crs with the CRS of the scans.")
        return area
    return request.read_area(projected_crs(request.options.crs, "the scans"))
