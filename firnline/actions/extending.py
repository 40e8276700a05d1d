"""Map ground beyond the range of a scanner with the images of its drive."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import survey
from firnline.actions.interface import (
    Preview,
    Progress,
    WrittenResult,
    no_progress,
    previewed_by,
    refuse_existing,
)
from firnline.actions.requests import ExtendRequest
from survey.core import BoolArray, InputError, picture_files, replacing_folder
from survey.core.documents import write_json
from survey.io.raster import write_raster

if TYPE_CHECKING:
    from vision_slam.extended_map import ExtendedMap
    from vision_slam.orthoimage import Orthoimage

OWN_FILES = ("map.tif", "orthoimage.tif", "heights.gpkg", "extend.json", *picture_files("extended"))
"""Names of the files that an extended map consists of."""
_HALF, _NEAR_M = 0.5, 2.0
_MOST_NODES, _MOST_CELLS = 250_000, 4_000_000


@dataclass(frozen=True)
class ExtendResult(WrittenResult):
    """Map of scans and images, its orthoimage, and the places where the two contradict each other.

    Parameters
    ----------
    request : ExtendRequest
        What was asked for.
    path : survey.Trajectory
        Path of the drive.
    found : ExtendedMap
        The map, heights from images and contradictions.
    image : Orthoimage
        Grey or colour of the ground.
    """

    request: ExtendRequest
    path: survey.Trajectory
    found: "ExtendedMap"
    image: "Orthoimage"

    def _write_files(self) -> None:
        """Write map, orthoimage, heights, facts and picture into a folder."""
        made = self.found.reconstruction
        with replacing_folder(self.request.out, own=OWN_FILES) as draft:
            bands = {"elevation": made.mean.elevation, "standard_deviation": made.std.elevation}
            write_raster(
                draft / "map.tif", bands, made.mean.transform, made.mean.crs, made.mean.vertical_datum
            )
            grid = self.image.grid
            write_raster(draft / "orthoimage.tif", self.image.named, grid.transform, grid.crs)
            self.found.heights.write(draft / "heights.gpkg")
            write_json(draft / "extend.json", self.facts())
            self.request.write_pictures(draft, self._pictures)

    def _pictures(self) -> dict[str, Any]:
        from vision_slam.plotting import extended_map

        return {"extended": extended_map(self.found, self.image, self.path.position[:, :2])}

    def facts(self) -> dict[str, Any]:
        """Return numbers of heights, learned errors and contradictions."""
        found, errors = self.found, self.found.errors
        beyond = self._is_extended
        stated: dict[str, Any] = {
            "n_heights": len(found.heights),
            "n_beyond_scans": int(self._is_beyond.sum()),
            "error_factor": errors.factor,
            "floor_m": errors.floor_m,
            "error_per_metre_of_range": errors.per_metre,
            "n_learned": errors.n_learned,
            "n_tested": errors.n_tested,
            "sigma_beyond_m": _median(found.reconstruction.std.elevation[beyond]),
            "sigma_beyond_of_scans_alone_m": _median(found.scans_alone.std.elevation[beyond]),
            "orthoimage_share": self.image.seen_share,
            "contradictions": [one._asdict() for one in found.contradictions],
        }
        if errors.n_tested:
            stated["coverage_95"] = errors.coverage
        return stated

    @property
    def _is_beyond(self) -> BoolArray:
        """Whether each height lies beyond the scans."""
        scanned = survey.Dem.on(self.found.scans_alone.mean.grid(), self.found.is_scanned.astype(np.float64))
        return np.asarray(scanned.at(self.found.heights.xyz[:, :2])) < _HALF

    @property
    def _is_extended(self) -> BoolArray:
        """Whether each node (H, W) lies beyond the scans and near a height."""
        from scipy.spatial import cKDTree

        away = np.asarray(cKDTree(self.found.heights.xyz[:, :2]).query(self.found.scans_alone.mean.xy)[0])
        return ~self.found.is_scanned & (away.reshape(self.found.is_scanned.shape) <= _NEAR_M)

    def lines(self) -> list[str]:
        """Return heights, errors, contradictions by reason, and the place of the map."""
        facts = self.facts()
        checked = (
            f"{100 * facts['coverage_95']:.0f} % of {facts['n_tested']} held-out heights within their 95 % interval"
            if "coverage_95" in facts
            else "too few heights beside scans to test them, errors are assumed"
        )
        reasons = [one.reason for one in self.found.contradictions]
        named = ", ".join(f"{reasons.count(reason)} × {reason}" for reason in dict.fromkeys(reasons))
        return [
            f"heights from images: {facts['n_heights']}, {facts['n_beyond_scans']} of them beyond the scans",
            f"errors: {facts['floor_m']:.3f} m, {1e3 * facts['error_per_metre_of_range']:.1f} mm per metre of range, and {facts['error_factor']:.1f} times what correlation shows; {checked}",
            f"standard deviation where images extend the scans: {facts['sigma_beyond_m']:.2f} m (median), {facts['sigma_beyond_of_scans_alone_m']:.2f} m without images",
            f"contradictions: {named or 'none'}",
            f"orthoimage: {100 * facts['orthoimage_share']:.0f} % of the map is seen",
            f"map: {self.request.out}",
        ]


def _median(values: Any) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def preview_extension(request: ExtendRequest) -> Preview:
    """Read recording, path and landmarks, and return their numbers."""
    recording, path, landmarks, grid, _ = _inputs(request)
    images = 0 if recording.frames is None else len(recording.frames)
    facts = {
        "images": images,
        "poses": len(path),
        "landmarks": len(landmarks),
        "nodes": int(np.prod(grid.shape)),
    }
    return Preview.of([request.out], facts)


@previewed_by(preview_extension)
def extend(request: ExtendRequest, progress: Progress = no_progress) -> ExtendResult:
    """Map ground beyond the range of a scanner with the images of its drive.

    Parameters
    ----------
    request : ExtendRequest
        Recording, its localization, and the map that is wanted.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    ExtendResult
        Map, orthoimage and contradictions; `ExtendResult.write` writes them.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    """
    recording, path, landmarks, grid, prior = _inputs(request)
    from vision_slam.extended_map import extend_map
    from vision_slam.ground_heights import ImageHeightsConfig
    from vision_slam.orthoimage import orthoimage

    config = ImageHeightsConfig(farthest_m=request.reach_m)
    found = extend_map(recording, path, landmarks, grid, prior, config=config, progress=progress)
    assert recording.frames is not None
    assert recording.camera is not None
    cells = survey.Grid.over(grid.bounds, request.pixel_m, grid.crs)
    image = orthoimage(
        recording.frames, recording.camera, path, found.reconstruction.mean, cells, farthest_m=request.reach_m
    )
    return ExtendResult(request, path, found, image)


def _inputs(
    request: ExtendRequest,
) -> tuple[survey.Recording, survey.Trajectory, survey.SurfacePoints, survey.Grid, survey.Dem | None]:
    """Read recording, path, landmarks and prior, and lay the grid of the map."""
    inputs = [request.recording, request.localization, request.prior]
    refuse_existing([request.out], force=request.force, inputs=inputs, own=OWN_FILES)
    recording = survey.Recording.read(request.recording)
    path = survey.Trajectory.read(request.localization / "trajectory.csv", recording.crs)
    landmarks = survey.SurfacePoints.read(_landmarks_in(request))
    area = None if request.area is None else survey.SurveyArea.read(request.area, crs=recording.crs)
    if area is None:
        low, high = path.position[:, :2].min(axis=0), path.position[:, :2].max(axis=0)
        bounds = (*(low - request.reach_m).tolist(), *(high + request.reach_m).tolist())
    else:
        bounds = area.bounds
    grid = survey.Grid.over(bounds, request.grid, recording.crs)
    if np.prod(grid.shape) > _MOST_NODES:
        raise InputError(
            f"the map would have {np.prod(grid.shape):,} nodes and {_MOST_NODES:,} are the most; choose a larger --grid than {request.grid:g} m."
        )
    if np.prod(grid.shape) * (request.grid / request.pixel_m) ** 2 > _MOST_CELLS:
        raise InputError(
            f"the orthoimage would have more than {_MOST_CELLS:,} cells; choose a larger --pixel than {request.pixel_m:g} m."
        )
    prior = None if request.prior is None else survey.Dem.read(request.prior)
    return recording, path, landmarks, grid, prior


def _landmarks_in(request: ExtendRequest) -> Any:
    """Return the file of landmarks of a localization, or of the stage of a run."""
    for name in ("landmarks.gpkg", "surface_points.gpkg"):
        if (request.localization / name).exists():
            return request.localization / name
    raise InputError(
        f"{request.localization} holds no landmarks.gpkg; name the folder that firnline localize wrote, with fixes."
    )
