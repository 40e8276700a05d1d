"""Map terrain from points, from several drives, or from LiDAR scans; map a quantity that was logged on a drive.

The inputs are read and checked, the map is made, and its folder is written.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from pyproj import CRS

import survey
from firnline.actions.interface import (
    Preview,
    Progress,
    Result,
    fact_line,
    figure_lines,
    no_progress,
    own_crs,
    read_about,
    refuse_existing,
)
from firnline.actions.mapping_request import MapRequest, map_request
from firnline.actions.requests import PayloadRequest, ReconstructRequest
from survey.core import ConfigError, InputError, projected_crs, read_json
from survey.core.replacement import replacing_folder
from survey.data.ice_motion import ICE_MOTION, IceMotion, read_motion, write_motion
from survey.data.sensors.odometry import DriveTies
from survey.data.sensors.payload import PayloadLog, Quantity
from survey.interchange.scans import SensorPath, read_scans, read_sensor_scans, scan_files
from survey.io.column_names import parse_columns
from survey.reconstruction.beyond_points import beyond_sentences
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reconstruction.line_of_sight.scan_points import BeamErrors, scan_points
from survey.reconstruction.mapping import cut_to_area, map_landmarks, map_scans
from survey.reconstruction.method import MappedTerrain, ScanSettings
from survey.reconstruction.motion.epoch import at_epoch, with_age
from survey.reconstruction.motion.refinement import refined_motion
from survey.reconstruction.observations import SoundPoints, sound_points
from survey.reconstruction.payload import map_payload, payload_grid, write_payload
from survey.reconstruction.terrain_map import ELEVATION
from vision_slam.fusion.pose_constraints import tie_drives

OWN_FILES = (
    *("dem.tif", "support.tif", "bounds.tif", "no_go.tif", "reconstruction.json"),
    *("mean.png", "sigma.png", "width.png", "support.png"),
    ICE_MOTION,
    *("corrected_trajectory*.csv", "corrected_trajectory*.error.npz", "*.aux.xml"),
)
"""Patterns of the files that a reconstruction consists of."""
PAYLOAD_FILES = ("dem.tif", "support.tif", "reconstruction.json", "*.nc", "*.aux.xml")
"""Patterns of the files that a map of a payload consists of."""
_BOUNDING_BOX = "bounding box of the points"
_MOST_DRAWN_NODES = 4_000_000


@dataclass(frozen=True, kw_only=True)
class MapResult(Result):
    """A map from points or scans.

    Parameters
    ----------
    request : MapRequest
        Request that was checked.
    reconstruction : Reconstruction
        The map.
    origin : str
        How it was made.
    corrected : sequence of Trajectory
        Corrected path of each drive of a joint map.
    motion : IceMotion, optional
        Motion of the ice after the map.
    """

    request: MapRequest
    reconstruction: survey.Reconstruction
    origin: str
    corrected: Sequence[survey.Trajectory] = ()
    motion: IceMotion | None = None

    @property
    def out(self) -> Path:
        """Folder of the map."""
        return self.request.options.out

    def write(self, out: Path | None = None) -> "MapResult":
        """Write the map into a new folder that replaces the old one when it is complete.

        Parameters
        ----------
        out : pathlib.Path, optional
            The folder; that of the request by default.

        Returns
        -------
        MapResult
            The result at its place.
        """
        placed = self if out is None else replace(self, request=self.request.at(out))
        with replacing_folder(placed.out, own=OWN_FILES) as draft:
            self._recorded().write(draft)
            for k, path in enumerate(self.corrected, 1):
                number = "" if len(self.corrected) == 1 else f"_{k}"
                path.write(draft / f"corrected_trajectory{number}.csv")
            if self.motion is not None:
                write_motion(self.motion, draft / ICE_MOTION)
            _draw(self.reconstruction, draft)
            if self.request.config.rays:
                _mark(self.reconstruction, draft, self.request.options.max_slope_deg)
        return placed

    def lines(self) -> list[str]:
        """Return size, area, hyperparameters and findings of the map."""
        result = self.reconstruction
        rows, columns = result.mean.shape
        hint = " (name a polygon with --area)" if self.request.options.area is None else ""
        lines = [
            f"{rows} × {columns} nodes {self.origin}, written to {self.out / 'dem.tif'}",
            fact_line("area", f"{self._area_text}{hint}"),
            *figure_lines(result.hyperparameters),
            *_findings(result),
        ]
        if result.quantity == ELEVATION:
            scored = f"firnline score {self.out / 'dem.tif'} --truth REFERENCE, or --checkpoints POINTS.csv"
            lines.append(fact_line("next", scored))
        return lines

    def facts(self) -> dict[str, Any]:
        """Return the record of the map that was written."""
        return read_json(self.out / "reconstruction.json", "the record of the map")

    def as_json(self) -> str:
        """Return the record of the map as it was written."""
        return (self.out / "reconstruction.json").read_text(encoding="utf-8")

    @property
    def _area_text(self) -> str:
        area = self.request.options.area
        return _BOUNDING_BOX if area is None else str(area)

    def _recorded(self) -> survey.Reconstruction:
        """Return the map with the area that it covers in its record."""
        diagnostics = {**self.reconstruction.diagnostics, "area": self._area_text}
        return replace(self.reconstruction, diagnostics=diagnostics)


def reconstruct(request: ReconstructRequest, progress: Progress = no_progress) -> MapResult:
    """Map terrain, or another sampled quantity, from points or LiDAR scans.

    Parameters
    ----------
    request : ReconstructRequest
        Files and settings.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    MapResult
        The map; `MapResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, an output that exists, or an option that the method does not use.
    ConfigError
        A setting that is unknown or wrong.
    """
    checked = _checked(request)
    return _map_scans(checked, progress) if checked.is_of_scans else _map_points(checked, progress)


def preview_reconstruction(request: ReconstructRequest) -> Preview:
    """Read and check all input of a map, and return what would be mapped."""
    checked = _checked(request)
    if checked.is_of_scans:
        stated = {"scans": f"{len(scan_files(request.sources))} files"}
    else:
        stated = _read_inputs(checked).facts
    return Preview.of([request.out], {"method": checked.method.name, **stated})


def _checked(request: ReconstructRequest) -> MapRequest:
    checked = map_request(request)
    refuse_existing([request.out], force=request.force, inputs=checked.inputs, own=OWN_FILES)
    return checked


def _draw(result: survey.Reconstruction, out: Path) -> None:
    """Write pictures of mean, standard deviation and support; large maps have none, and a log entry says so."""
    from survey.figures import deviation_map, support_map, survey_map
    from survey.figures.style import png_bytes

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
    from survey.figures.maps import width_map
    from survey.figures.style import png_bytes
    from survey.reconstruction.hazards import steep_ground

    if result.lower is None or result.upper is None:
        return
    (out / "width.png").write_bytes(png_bytes(width_map(result)))
    if max_slope_deg is not None:
        steep_ground(result, max_slope_deg).write(out / "no_go.tif")


def blunder_text(found: Mapping[str, Any]) -> str:
    """Return the sentence about blunders that were left out, with the file or the number of the scan that holds them."""
    scan = f"scan {found['scan']}" if "scan" in found else None
    place = found.get("file", scan)
    return f"{place}: {found['sentence']}" if place else str(found["sentence"])


def _findings(result: survey.Reconstruction) -> list[str]:
    """Return the check by points left out, the classes by the map's claim, and what is to be known of the input."""
    from survey.scoring.standards.map_classes import own_claim

    sentences = own_claim(result) if result.quantity == ELEVATION else beyond_sentences(result)
    if result.method == "tin":
        sentences = [
            *sentences,
            "σ is that of the points alone, without the relief between them; no class is stated.",
        ]
    lines = [fact_line("map", sentence) for sentence in sentences]
    found = result.diagnostics
    share, n_low, offset_m = (
        found.get(name) for name in ("prior_covered_share", "n_low_returns", "satellite_offset_m")
    )
    if share is not None:
        lines.append(fact_line("prior", f"covers {100.0 * share:.1f} % of the map; the rest has no height"))
    lines += [fact_line("left out", blunder_text(each)) for each in found.get("blunders", ())]
    if n_low:
        lines.append(fact_line("left out", f"{n_low} isolated low returns"))
    if offset_m is not None:
        sigma_m = found["satellite_offset_m_sigma"]
        lines.append(fact_line("prior", f"lies {offset_m:+.2f} ± {sigma_m:.2f} m from the map"))
    return [*lines, *(fact_line("warning", conflict) for conflict in found.get("prior_conflicts", ()))]


class PointInputs(NamedTuple):
    """Inputs of a map from points, read and checked."""

    drives: SeveralDrives
    grid: survey.Grid
    area: survey.SurveyArea | None
    paths: list[survey.Trajectory]
    prior: survey.Dem | None
    blunders: tuple[dict[str, Any], ...]

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


def _read_inputs(request: MapRequest) -> PointInputs:
    """Read the points, and with them area, paths and prior, onto the nodes of the map."""
    options = request.options
    if request.is_registered:
        paths = [_path(file, options.crs) for file in options.trajectories]
        scans = [_registered(request, *each) for each in zip(options.sources, paths, strict=True)]
        sound = [
            sound_points(seen, has_area=options.area is not None, file=str(file))
            for seen, file in zip(scans, options.sources, strict=True)
        ]
        parts = [each.points for each in sound]
    else:
        sound = [_sound_points(request, file) for file in options.sources]
        parts = [each.points for each in sound]
        paths = [_path(file, part.crs) for file, part in zip(options.trajectories, parts, strict=False)]
    errors = [path.error for path in paths] or [None]
    drives = SeveralDrives.of(list(zip(parts, errors, strict=True)))
    if options.ties is not None:
        drives = tie_drives(drives, paths, DriveTies.read(options.ties))
    points = drives.points
    area = request.read_area(points.crs)
    grid = request.grid_over(_bounds(points) if area is None else area.bounds, points.crs)
    prior = None if options.prior is None else _prior(options.prior, grid)
    blunders = tuple(found for each in sound for found in each.blunders)
    return PointInputs(drives, grid, area, paths, prior, blunders)


def _sound_points(request: MapRequest, file: Path) -> SoundPoints:
    """Read points without gross blunders of their heights; refuse feet, and far places where no area is named."""
    options = request.options
    points = survey.SurfacePoints.read(
        file, crs=options.crs, sigma_m=options.sigma_m, columns=parse_columns(options.columns)
    )
    return sound_points(points, options.value or ELEVATION, has_area=options.area is not None, file=str(file))


def _map_points(request: MapRequest, progress: Progress) -> MapResult:
    """Map the points of a file, or of several drives, over the area, or over their bounding box."""
    drives, grid, area, paths, prior, blunders = _read_inputs(request)
    mapped = map_landmarks(
        drives.points,
        grid,
        request.config,
        prior=prior,
        path=drives.path,
        quantity=request.options.value or ELEVATION,
        progress=progress,
        area=area,
        blunders=blunders,
    )
    moved, motion = _on_ice(mapped, request)
    result = moved if area is None else cut_to_area(moved, area)
    corrected: list[survey.Trajectory] = []
    if mapped.correction is not None:
        parts = drives.corrections(mapped.correction)
        corrected = [part.applied(path) for part, path in zip(parts, paths, strict=True)]
    return MapResult(
        request=request,
        reconstruction=result,
        origin=f"by {request.method.name}",
        corrected=corrected,
        motion=motion,
    )


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


def _map_scans(request: MapRequest, progress: Progress) -> MapResult:
    """Map scans as they are read, over the area or over all that they show."""
    files = scan_files(request.options.sources)
    track = next((SensorPath.read(file) for file in request.options.trajectories), None)
    area = _area_of_scans(request)
    grid = None if area is None else request.grid_over(area.bounds, area.crs)
    config = request.config
    settings = ScanSettings(request.step_m, rays=config.rays, configs=config.configs_of(request.method))
    made = map_scans(
        read_scans(files, crs=request.options.crs, sigma_m=request.options.sigma_m, track=track),
        request.method,
        settings,
        grid=grid,
        on_scan=lambda n: progress("scans", n, max(len(files), n)),
    )
    result = made.reconstruction if area is None else cut_to_area(made.reconstruction, area)
    return MapResult(request=request, reconstruction=result, origin=f"from {made.n_scans} scans")


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


@dataclass(frozen=True)
class PayloadResult(Result):
    """Map of a quantity that was logged on a drive.

    Parameters
    ----------
    request : PayloadRequest
        What was asked for.
    log : PayloadLog
        The first log, which states the quantity.
    mapped : Reconstruction
        The map.
    """

    request: PayloadRequest
    log: PayloadLog
    mapped: survey.Reconstruction

    def write(self, out: Path | None = None) -> "PayloadResult":
        """Write GeoTIFF, NetCDF and facts into a folder.

        Parameters
        ----------
        out : pathlib.Path, optional
            The folder; that of the request by default.

        Returns
        -------
        PayloadResult
            The result at its place.
        """
        placed = self if out is None else replace(self, request=replace(self.request, out=out))
        with replacing_folder(placed.request.out, own=PAYLOAD_FILES) as draft:
            write_payload(self.mapped, self.log, draft)
        return placed

    def lines(self) -> list[str]:
        """Return readings, length scale, dependence on elevation, noise, and the place of the map."""
        found = self.mapped.hyperparameters
        return [
            f"{self.log.quantity.label}: {self.mapped.diagnostics['n_readings']} readings, length scale "
            f"{found['length_scale_m']:.0f} m, {found['per_km_of_elevation']:+.2f} ± "
            f"{found['per_km_of_elevation_sigma']:.2f} per km of elevation, noise {found['noise_sd']:.3g}",
            f"map: {self.request.out}",
        ]


def payload(request: PayloadRequest) -> PayloadResult:
    """Map a quantity that was logged on a drive, with elevation as covariate.

    Parameters
    ----------
    request : PayloadRequest
        Logs, paths and terrain.

    Returns
    -------
    PayloadResult
        The map; `PayloadResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    """
    logs, paths, terrain = _payload_inputs(request)
    return PayloadResult(request, logs[0], map_payload(logs, paths, terrain, payload_grid(terrain.grid())))


def preview_payload(request: PayloadRequest) -> Preview:
    """Read logs, paths and terrain, and return their numbers."""
    logs, _, _ = _payload_inputs(request)
    return Preview.of([request.out], {"logs": len(logs), "paths": len(request.trajectories)})


def _payload_inputs(
    request: PayloadRequest,
) -> tuple[list[PayloadLog], list[survey.Trajectory | None], survey.Dem]:
    """Read logs, the path of each drive (None where none is given), and the terrain."""
    inputs = (*request.logs, *request.trajectories, request.terrain)
    refuse_existing([request.out], force=request.force, inputs=inputs, own=PAYLOAD_FILES)
    terrain = survey.Dem.read(request.terrain)
    quantity = Quantity(
        name=request.name,
        unit=request.unit,
        standard_name=request.standard_name,
        noise_sd=request.noise_sd,
        lag_s=request.lag_s,
    )
    logs = [PayloadLog.read(file, quantity) for file in request.logs]
    if not request.trajectories:
        return logs, [None] * len(logs), terrain
    if len(request.trajectories) != len(logs):
        raise ConfigError(
            f"{len(logs)} logs and {len(request.trajectories)} trajectories were given; give one --trajectory for "
            "each log, in the same order."
        )
    return logs, [survey.Trajectory.read(file, terrain.crs) for file in request.trajectories], terrain
