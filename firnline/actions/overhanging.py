"""Estimate the surface of steep walls, undercuts and serac edges from LiDAR scans, with its standard deviation."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

import survey
from firnline.actions.interface import (
    Preview,
    Progress,
    WrittenResult,
    no_progress,
    previewed_by,
    refuse_existing,
)
from firnline.actions.requests import OverhangsRequest
from survey.core import FloatArray, InputError, picture_files, replacing_folder, same_crs
from survey.core.crs import crs_text
from survey.core.documents import write_json
from survey.data.sensors.lidar import SensorScan
from survey.interchange.scans import (
    SensorPath,
    holds_sensor_scans,
    read_scans,
    read_sensor_scans,
    scan_files,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from survey.reconstruction import FreeSurface
    from survey.reconstruction.lattice.steep_places import SteepSection

OWN_FILES = ("surface.ply", "overhangs.json", *picture_files("overhangs"))
"""Names of the files that a surface consists of."""
_MOST_RETURNS, _MOST_CELLS, _PAD_IN_STEPS = 2_000_000, 8_000_000, 11.0
# With more places a scanner moves, and its returns count as one scan.
_MOST_PLACES = 64


@dataclass(frozen=True)
class OverhangsResult(WrittenResult):
    """Surface that may overhang, and sections through its steepest places.

    Parameters
    ----------
    request : OverhangsRequest
        What was asked for.
    returns : SurfacePoints
        Returns with their errors.
    surface : FreeSurface
        Mesh with standard deviations.
    sections : list of SteepSection
        From the steepest place on.
    """

    request: OverhangsRequest
    returns: survey.SurfacePoints
    surface: "FreeSurface"
    sections: "list[SteepSection]"

    def _write_files(self) -> None:
        """Write surface, facts and picture into a folder."""
        with replacing_folder(self.request.out, own=OWN_FILES) as draft:
            self.surface.write(draft / "surface.ply")
            write_json(draft / "overhangs.json", self.facts())
            self.request.write_pictures(draft, self._pictures)

    def _pictures(self) -> "dict[str, Figure]":
        from survey.figures.overhangs import overhang_sections

        return {"overhangs": overhang_sections(self.surface, self.sections, self.returns)}

    def facts(self) -> dict[str, Any]:
        """Return numbers of returns and nodes, areas, standard deviations, learned scales, and the sections."""
        from survey.reconstruction.lattice.steep_places import OVERHANGING_DEG, STEEP_DEG, Facets

        surface, facets = self.surface, Facets.of(self.surface)
        seen, area_m2 = surface.is_supported, float(facets.area_m2.sum())
        stated: dict[str, Any] = {
            "crs": crs_text(self.returns.crs),
            "vertical_datum": self.returns.vertical_datum,
            "n_returns": len(self.returns),
            "n_places": self._n_places,
            "step_m": surface.step_m,
            "n_nodes": len(surface.nodes),
            "n_triangles": len(surface.triangles),
            "area_m2": area_m2,
            "supported_share": float(facets.area_m2[facets.is_supported].sum()) / area_m2,
            "steep_m2": facets.area_beyond(STEEP_DEG),
            "overhanging_m2": facets.area_beyond(OVERHANGING_DEG),
            "bending_m": surface.bending_m,
            "roughness_m": surface.roughness_m,
            "factor_near_returns": surface.factors[0],
            "factor_in_gaps": surface.factors[1],
            "sections": [
                {"start_m": one.start.tolist(), "end_m": one.end.tolist(), "steepness_deg": one.steepness_deg}
                for one in self.sections
            ],
        }
        for name, which in (("supported", seen), ("unsupported", ~seen)):
            if which.any():
                stated[f"sigma_{name}_m"] = float(np.median(surface.sigma_m[which]))
        return stated

    @property
    def _n_places(self) -> int:
        assert self.returns.origins is not None
        return len(np.unique(self.returns.origins, axis=0))

    def lines(self) -> list[str]:
        """Return returns, areas, standard deviations, sections, and the place of the surface."""
        facts = self.facts()
        sigmas = [
            f"{facts[name]:.3f} m {where}"
            for name, where in (
                ("sigma_supported_m", "where returns support it"),
                ("sigma_unsupported_m", "elsewhere"),
            )
            if name in facts
        ]
        sections = [
            f"section {letter}: {east:.1f} E, {north:.1f} N, {one.steepness_deg:.0f}° steep"
            for letter, one in zip("ABC", self.sections, strict=False)
            for east, north in [0.5 * (one.start + one.end)]
        ]
        return [
            f"returns: {facts['n_returns']} from {facts['n_places']} {'place' if facts['n_places'] == 1 else 'places'} of the scanner",
            f"surface: {facts['area_m2']:.1f} m², {100 * facts['supported_share']:.0f} % supported by returns; {facts['steep_m2']:.1f} m² of these are steeper "
            f"than 60°, {facts['overhanging_m2']:.1f} m² overhang",
            f"standard deviation along the normal (median): {', '.join(sigmas)}",
            *(sections or ["sections: none, no supported ground is steeper than 60°"]),
            f"surface: {self.request.out / 'surface.ply'}",
        ]

    @property
    def notes(self) -> list[str]:
        """The error that all returns of a scan share, where neither several scans show it nor the input states it."""
        assert self.returns.covariance is not None
        if (
            1 < self._n_places <= _MOST_PLACES
            or (self.returns.covariance != self.returns.own_covariance).any()
        ):
            return []
        return [
            "one scan, or a moving scanner, does not show the error of its place, and none is stated; give it with --scan-sigma."
        ]


def preview_overhangs(request: OverhangsRequest) -> Preview:
    """Read all scans, and return their numbers."""
    returns = _read_returns(request, no_progress)
    east, north, up = np.ptp(returns.xyz, axis=0)
    stated = {
        "returns": f"{len(returns)}, {returns.crs.name}",
        "extent": f"{east:.1f} × {north:.1f} × {up:.1f} m",
        "nodes": f"{request.step_m:g} m apart",
    }
    return Preview.of([request.out], stated)


@previewed_by(preview_overhangs)
def overhangs(request: OverhangsRequest, progress: Progress = no_progress) -> OverhangsResult:
    """Estimate the surface of steep walls, undercuts and serac edges from LiDAR scans, with its standard deviation.

    Parameters
    ----------
    request : OverhangsRequest
        Scans, their errors where they state none, and the distance between nodes.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    OverhangsResult
        Surface and sections; `OverhangsResult.write` writes them.

    Raises
    ------
    InputError
        Input that cannot be used, more returns or nodes than fit, or an output that exists.
    """
    returns = _read_returns(request, progress)
    from survey.reconstruction import free_lattice
    from survey.reconstruction.lattice.steep_places import steep_sections

    progress("surface", 0, 1)
    surface = free_lattice(returns, request.step_m)
    progress("surface", 1, 1)
    return OverhangsResult(request, returns, surface, steep_sections(surface))


def _read_returns(request: OverhangsRequest, progress: Progress) -> survey.SurfacePoints:
    """Read all returns inside the area, with origins, covariances, and covariances of their own errors; refuse more than fit."""
    inputs = [*request.sources, request.trajectory, request.area]
    refuse_existing([request.out], force=request.force, inputs=inputs, own=OWN_FILES)
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
        if sum(map(len, parts)) + inside.sum() > _MOST_RETURNS:
            raise InputError(
                f"the scans hold more than {_MOST_RETURNS:,} returns; name a part of the ground with --area."
            )
        if inside.any():
            parts.append(_with_errors(scan.select(inside), request))
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
        if scan.origins is None:
            raise InputError(
                f"the scan {file} does not state where the scanner stood; add the columns origin_x_m, origin_y_m and origin_z_m (npz: "
                "origin), or name its path with --trajectory."
            )
        yield scan
        progress("scans", number, len(files))


def _with_errors(scan: survey.SurfacePoints, request: OverhangsRequest) -> survey.SurfacePoints:
    """Return a scan with covariances: those that it states, or those along and across its rays and of its place."""
    from survey.reconstruction import beam_covariance

    assert scan.origins is not None
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
