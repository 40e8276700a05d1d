"""Map terrain from points, from several drives, or from LiDAR scans: the map is made, and its folder is written."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import survey
from firnline.actions.interface import (
    Preview,
    Progress,
    WrittenResult,
    fact_line,
    figure_lines,
    no_progress,
    previewed_by,
    refuse_existing,
)
from firnline.actions.map_inputs import blunder_text, read_points
from firnline.actions.mapping_request import MapRequest, map_request
from firnline.actions.requests import ReconstructRequest
from survey.core import picture_files, read_json, replacing_folder
from survey.data.ice_motion import ICE_MOTION, IceMotion, read_motion, write_motion
from survey.reconstruction.mapping import cut_to_area, map_landmarks, map_scans
from survey.reconstruction.motion.refinement import on_ice
from survey.reconstruction.terrain_map import ADJUSTMENT, ELEVATION, METHOD_CHOICE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OWN_FILES = (
    *("dem.tif", "support.tif", "bounds.tif", "no_go.tif", "reconstruction.json"),
    *picture_files("mean", "sigma", "width", "support"),
    ICE_MOTION,
    *("corrected_trajectory*.csv", "corrected_trajectory*.error.npz", "*.aux.xml"),
)
"""Patterns of the files that a reconstruction consists of."""
_BOUNDING_BOX = "bounding box of the points"
_MOST_DRAWN_NODES = 4_000_000


@dataclass(frozen=True, kw_only=True)
class MapResult(WrittenResult):
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

    def _request_at(self, out: Path) -> MapRequest:
        return self.request.at(out)

    def _write_files(self) -> None:
        """Write the map into a new folder that replaces the old one when it is complete."""
        with replacing_folder(self.out, own=OWN_FILES) as draft:
            self._recorded().write(draft)
            for k, path in enumerate(self.corrected, 1):
                number = "" if len(self.corrected) == 1 else f"_{k}"
                path.write(draft / f"corrected_trajectory{number}.csv")
            if self.motion is not None:
                write_motion(self.motion, draft / ICE_MOTION)
            options = self.request.options
            options.write_pictures(draft, lambda: _drawn(self.reconstruction, self.request.config.rays))
            if options.max_slope_deg is not None:
                _mark(self.reconstruction, draft, options.max_slope_deg)

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


def preview_reconstruction(request: ReconstructRequest) -> Preview:
    """Read and check all input of a map, and return what would be mapped."""
    checked = _checked(request)
    if checked.is_of_scans:
        stated = {"scans": f"{len(checked.scan_files)} files"}
    else:
        stated = read_points(checked).facts
    return Preview.of([request.out], {"method": checked.method.name, **stated})


@previewed_by(preview_reconstruction)
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


def _checked(request: ReconstructRequest) -> MapRequest:
    checked = map_request(request)
    refuse_existing([request.out], force=request.force, inputs=checked.inputs, own=OWN_FILES)
    return checked


def _drawn(result: survey.Reconstruction, with_width: bool) -> "dict[str, Figure]":
    """Draw mean, standard deviation, support and width, all of one size; large maps are not drawn, and a log entry says so."""
    from survey.figures import deviation_map, support_map, survey_map, width_map
    from survey.figures.style import FULL_IN

    if result.quantity != ELEVATION:
        return {}
    if result.support.size > _MOST_DRAWN_NODES:
        logging.getLogger(__name__).warning(
            "the map has %s nodes; pictures are drawn of up to %s.",
            f"{result.support.size:,}",
            f"{_MOST_DRAWN_NODES:,}",
        )
        return {}
    figures = {
        "mean": survey_map(result.mean),
        "sigma": deviation_map(result, width_in=FULL_IN),
        "support": support_map(result, width_in=FULL_IN),
    }
    if with_width and result.lower is not None and result.upper is not None:
        figures["width"] = width_map(result, width_in=FULL_IN)
    return figures


def _mark(result: survey.Reconstruction, out: Path, max_slope_deg: float) -> None:
    """Write the ground that is certainly too steep by the bounds."""
    from survey.reconstruction.hazards import steep_ground

    if result.lower is not None and result.upper is not None:
        steep_ground(result, max_slope_deg).write(out / "no_go.tif")


def _findings(result: survey.Reconstruction) -> list[str]:
    """Return the check by points left out, the classes by the map's claim, and what is to be known of the input."""
    from survey.scoring.standards.map_classes import own_claim

    sentences = own_claim(result)
    found = result.diagnostics
    if result.method == "tin":
        alone = (
            ""
            if METHOD_CHOICE in found
            else "σ is that of the points alone, without the relief between them; "
        )
        sentences = [*sentences, f"{alone}no class is stated."]
    lines = [fact_line("map", sentence) for sentence in sentences]
    if METHOD_CHOICE in found:
        lines.append(fact_line("method", found[METHOD_CHOICE]["sentence"]))
    share, n_low, offset_m = (
        found.get(name) for name in ("prior_covered_share", "n_low_returns", "satellite_offset_m")
    )
    if share is not None:
        lines.append(fact_line("prior", f"covers {100.0 * share:.1f} % of the map; the rest has no height"))
    if ADJUSTMENT in found:
        lines.append(fact_line("strips", found[ADJUSTMENT]["sentence"]))
    lines += [fact_line("note", note) for note in found.get("notes", ())]
    lines += [fact_line("left out", blunder_text(each)) for each in found.get("blunders", ())]
    lines += [fact_line("warning", each["sentence"]) for each in found.get("contradictions", ())]
    if n_low:
        lines.append(fact_line("left out", f"{n_low} isolated low returns"))
    if offset_m is not None:
        sigma_m = found["satellite_offset_m_sigma"]
        lines.append(fact_line("prior", f"lies {offset_m:+.2f} ± {sigma_m:.2f} m from the map"))
    return [*lines, *(fact_line("warning", conflict) for conflict in found.get("prior_conflicts", ()))]


def _map_points(request: MapRequest, progress: Progress) -> MapResult:
    """Map the points of a file, or of several drives, over the area, or over their bounding box."""
    drives, grid, area, paths, prior, blunders, notes, strips = read_points(request)
    points, quantity, choice = drives.points, request.options.value or ELEVATION, None
    if request.leaves_method_open and drives.path is None and points.covariance is None:
        from survey.reconstruction.method_choice import compare_methods  # loads the engines

        choice = compare_methods(points, grid, area, quantity)
        request = request if choice is None else request.by(choice.method)
    mapped = map_landmarks(
        points,
        grid,
        request.config,
        prior=prior,
        path=drives.path,
        quantity=quantity,
        progress=progress,
        area=area,
        blunders=blunders,
    )
    result, motion = mapped.reconstruction, None
    result = result if choice is None else choice.recorded(result, points)
    if strips is not None:
        result = strips.recorded(result, points, is_adjusted=request.options.adjust_strips)
    if notes:
        result = replace(result, diagnostics={**result.diagnostics, "notes": list(notes)})
    if request.motion_file is not None and mapped.solution is not None:
        motion = read_motion(request.motion_file)
        result, motion = on_ice(result, motion, mapped.solution, request.options.epoch_s)
    result = result if area is None else cut_to_area(result, area)
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


def _map_scans(request: MapRequest, progress: Progress) -> MapResult:
    """Map scans as they are read, over the area or over all that they show."""
    area = request.area_of_scans()
    grid = None if area is None else request.grid_over(area.bounds, area.crs)
    n_files = len(request.scan_files)
    made = map_scans(
        request.read_scans(),
        request.method,
        request.scan_settings,
        grid=grid,
        on_scan=lambda n: progress("scans", n, max(n_files, n)),
    )
    result = made.reconstruction if area is None else cut_to_area(made.reconstruction, area)
    return MapResult(request=request, reconstruction=result, origin=f"from {made.n_scans} scans")
