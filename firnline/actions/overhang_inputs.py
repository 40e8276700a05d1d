"""Returns of LiDAR scans with the places of the scanner and their errors, read for surfaces that may overhang."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely

import survey
from firnline.actions.interface import Progress
from firnline.actions.requests import OverhangsRequest
from survey.core import FloatArray, InputError, same_crs
from survey.data.sensors.lidar import SensorScan
from survey.interchange.scans import (
    SensorPath,
    holds_sensor_scans,
    read_scans,
    read_sensor_scans,
    scan_files,
)

_MOST_RETURNS, _MOST_CELLS, _PAD_IN_STEPS = 2_000_000, 8_000_000, 11.0


def read_returns(request: OverhangsRequest, progress: Progress) -> survey.SurfacePoints:
    """Read all returns inside the area, with origins, covariances, and covariances of their own errors; refuse more than fit."""
    scans = (_registered if _are_in_sensor_frame(request) else _placed)(request, progress)
    area: survey.SurveyArea | None = None
    parts: list[survey.SurfacePoints] = []
    for scan in scans:
        if request.area is not None and area is None:
            area = survey.SurveyArea.read(request.area, crs=scan.crs)
        same_crs(scan.crs, (parts or [scan])[0].crs, "the first scan and a later one")
        inside = np.ones(len(scan), dtype=bool)
        if area is not None:
            inside = np.asarray(shapely.contains_xy(area.polygon, scan.xyz[:, :2]))
        if inside.any():
            parts.append(scan.select(inside))
        if sum(map(len, parts)) > _MOST_RETURNS:
            raise InputError(
                f"the scans hold more than {_MOST_RETURNS:,} returns; name a part of the ground with --area."
            )
    if not parts:
        raise InputError(
            f"no return of {', '.join(map(str, request.sources))} lies in {request.area or 'the time of the trajectory'}; check --area, "
            "--trajectory and the CRS."
        )
    returns = _joined(parts)
    _refuse_large(returns, request.step_m)
    return returns


def _refuse_large(returns: survey.SurfacePoints, step_m: float) -> None:
    size = np.ptp(returns.xyz, axis=0)
    if np.prod(size / step_m + _PAD_IN_STEPS) > _MOST_CELLS:
        east, north, up = size
        raise InputError(
            f"the returns extend over {east:.0f} × {north:.0f} × {up:.0f} m, more than {_MOST_CELLS:,} cells of {step_m:g} m; name a part of "
            "the ground with --area, or choose a larger --grid."
        )


def _are_in_sensor_frame(request: OverhangsRequest) -> bool:
    """Return whether the source is in the frame of its sensor; refuse paths that do not go with the sources."""
    path, sources = request.trajectory, request.sources
    found = [holds_sensor_scans(source) for source in sources]
    if not any(found):
        if path is not None and path.suffix == ".csv":
            raise InputError(
                f"{path} places scans in the frame of their sensor, and {sources[0]} holds none; name a TUM file for points with times, or "
                "leave --trajectory out."
            )
        return False
    if len(sources) > 1:
        raise InputError(
            f"{sources[found.index(True)]} holds scans in the frame of their sensor; name it alone, with its --trajectory."
        )
    if path is None or path.suffix != ".csv":
        raise InputError(
            f"the scans of {sources[0]} are in the frame of their sensor; name the path that firnline localize wrote with --trajectory "
            "trajectory.csv."
        )
    if request.crs is None:
        raise InputError(f"the trajectory {path} names no CRS; give it with --crs.")
    return True


def _registered(request: OverhangsRequest, progress: Progress) -> Iterator[survey.SurfacePoints]:
    """Yield scans in the frame of their sensor, placed by a path whose error their points share."""
    from survey.reconstruction.line_of_sight.scan_points import BeamErrors, every_return

    assert request.trajectory is not None
    assert request.crs is not None
    path = survey.Trajectory.read(request.trajectory, request.crs)
    found = read_sensor_scans(request.sources[0], path.time_s, request.sigma_m)
    errors = BeamErrors(found.range_sigma_m, found.angle_sigma_deg)
    yield from every_return(_timed(found.scans, path.time_s, progress), path, errors)


def _timed(scans: Iterator[SensorScan], time_s: FloatArray, progress: Progress) -> Iterator[SensorScan]:
    """Yield scans, and report the seconds that have passed of those of a path (N,) [s]."""
    total = round(time_s[-1] - time_s[0])
    for scan in scans:
        yield scan
        if len(scan.time_s):
            progress("seconds of the drive", int(np.clip(scan.time_s[-1] - time_s[0], 0, total)), total)


def _placed(request: OverhangsRequest, progress: Progress) -> Iterator[survey.SurfacePoints]:
    """Yield scans in the world that state where the scanner stood."""
    files = scan_files(request.sources)
    track = None if request.trajectory is None else SensorPath.read(request.trajectory)
    scans = read_scans(files, crs=request.crs, sigma_m=request.sigma_m, track=track, units=request.units)
    for number, (file, scan) in enumerate(zip(files, scans, strict=True), 1):
        yield _with_errors(scan, file, request)
        progress("scans", number, len(files))


def _with_errors(scan: survey.SurfacePoints, file: Path, request: OverhangsRequest) -> survey.SurfacePoints:
    """Return a scan with covariances: those that it states, or those along and across its rays and of its place."""
    from survey.reconstruction import beam_covariance

    if scan.origins is None:
        raise InputError(
            f"the scan {file} does not state where the scanner stood; add the columns origin_x_m, origin_y_m and origin_z_m (npz: "
            "origin), or name its path with --trajectory."
        )
    if scan.covariance is not None:
        own = scan.covariance if scan.own_covariance is None else scan.own_covariance
    else:
        along = scan.sigma_z[:, None, None] ** 2 * beam_covariance(scan.xyz, scan.origins, 1.0, 0.0)
        own = along + beam_covariance(scan.xyz, scan.origins, 0.0, request.beam_sigma_deg)
    is_shared = scan.own_covariance is not None
    return survey.SurfacePoints(
        scan.xyz,
        scan.covariance if is_shared else own + request.scan_sigma_m**2 * np.eye(3),
        origins=scan.origins,
        crs=scan.crs,
        vertical_datum=scan.vertical_datum,
        own_covariance=own,
    )


def _joined(parts: list[survey.SurfacePoints]) -> survey.SurfacePoints:
    """Return the returns of all scans as one set."""
    xyz, covariance, own, origins = (
        np.concatenate([np.asarray(getattr(part, name)) for part in parts])
        for name in ("xyz", "covariance", "own_covariance", "origins")
    )
    datum = next((part.vertical_datum for part in parts if part.vertical_datum), "")
    return survey.SurfacePoints(
        xyz, covariance, origins=origins, crs=parts[0].crs, vertical_datum=datum, own_covariance=own
    )
