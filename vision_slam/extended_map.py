"""One map of scans, landmarks, heights from images and a prior, beyond the range of the scanner.

`extend_map` maps scans and landmarks, takes heights from images about that map, learns their errors where scans see the same ground,
names the places where the two contradict each other, and maps all together. Every point names the keyframe it was seen from, so that the
errors of the path are estimated once for scans and images.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from survey.core import BoolArray, FloatArray, InputError, Progress
from survey.data import Dem, Grid, Recording, SurfacePoints, Trajectory
from survey.reconstruction.joint.drives import joined_points
from survey.reconstruction.line_of_sight.config import ScanPointsConfig
from survey.reconstruction.line_of_sight.scan_points import (
    BeamErrors,
    PathInterpolator,
    RegisteredReturns,
    place_scans,
    scan_points,
)
from survey.reconstruction.mapping import reconstruct
from survey.reconstruction.terrain_map import Reconstruction
from vision_slam.ground_heights import ImageHeightsConfig, heights_from_images
from vision_slam.scan_agreement import Contradiction, HeightErrors, ScanStrip, contradictions

_SCANNED_M = 1.5  # from a return
_SEEN_M = 3.0  # from a height of an image
SCANS = ScanPointsConfig(cell_m=1.5)
"""How scans become points: in the cells of the heights from images."""


@dataclass(frozen=True)
class ExtendedMap:
    """Map of scans and images.

    `scans_alone`: map of scans and landmarks. `reconstruction`: map of all. `heights`: heights from images with the errors that were learned, without
    those that contradict scans. `errors`: errors learned beside scans. `contradictions`: places where images contradict scans. `is_scanned` (H, W):
    nodes with a return within 1.5 m.
    """

    scans_alone: Reconstruction
    reconstruction: Reconstruction
    heights: SurfacePoints
    errors: HeightErrors
    contradictions: tuple[Contradiction, ...]
    is_scanned: BoolArray


def extend_map(
    recording: Recording,
    path: Trajectory,
    landmarks: SurfacePoints,
    grid: Grid,
    prior: Dem | None = None,
    *,
    config: ImageHeightsConfig | None = None,
    progress: Progress | None = None,
) -> ExtendedMap:
    """Map the ground that scans and images of a drive show.

    Parameters
    ----------
    recording : Recording
        Images with their calibration, and LiDAR scans.
    path : Trajectory
        Estimated path of the recording, with its error.
    landmarks : SurfacePoints
        Landmarks of the localization.
    grid : Grid
        Nodes of the map.
    prior : Dem, optional
        Expected surface, such as a satellite's.
    config : ImageHeightsConfig, optional
        How heights are taken from images.
    progress : callable, optional
        Progress callback (stage, done, total).

    Returns
    -------
    ExtendedMap
        Both maps, heights and contradictions.

    Raises
    ------
    InputError
        A recording without images or scans, a path without its error, or images that show no ground twice.

    Notes
    -----
    Beyond the scans nothing contradicts the images: ground that changed between two images of one place is left out as a bad match, ground that changed
    between images and today is not found.
    """
    if recording.frames is None or recording.camera is None or recording.lidar is None:
        missing = "LiDAR scans" if recording.lidar is None else "images with a calibration"
        raise InputError(
            f"the recording has no {missing}; name one with both scans and images, or map what it has by firnline reconstruct."
        )
    if path.error is None:
        raise InputError("the path has no error that scans and images share; localize the recording again.")
    beams = BeamErrors.of(recording.lidar.scanner)
    scanned = scan_points(recording.lidar, path, beams, config=SCANS, vertical_datum=recording.vertical_datum)
    returns = RegisteredReturns.joined(list(place_scans(recording.lidar, PathInterpolator(path), SCANS)))
    parts = [scanned, landmarks]
    alone = reconstruct(joined_points(parts, [0, 0]), grid, prior, path=path.error)
    seen = heights_from_images(
        recording.frames, recording.camera, path, alone.mean, config, progress=progress
    )
    strip = ScanStrip.between(seen, returns)
    errors = HeightErrors.learned(seen, strip)
    found, is_wrong = contradictions(seen, strip, errors)
    if is_wrong.all():
        raise InputError(
            "all heights from images contradict the scans; check calibration and times of the images."
        )
    heights = errors.added_to(seen.select(~is_wrong))
    together = reconstruct(joined_points([*parts, heights], [0, 0, 0]), grid, prior, path=path.error)
    is_scanned = _away_m(grid, returns.xyz) <= _SCANNED_M
    is_unseen = ~is_scanned & (_away_m(grid, heights.xyz) > _SEEN_M)
    together = _no_surer(together, alone, is_unseen)
    return ExtendedMap(alone, together, heights, errors, tuple(found), is_scanned)


def _away_m(grid: Grid, xyz: FloatArray) -> FloatArray:
    """Return the distance of the nodes (H, W) from the nearest of some places (N, 3) [m]."""
    away = cKDTree(xyz[:, :2]).query(grid.xy)[0]
    return np.asarray(away, dtype=np.float64).reshape(grid.shape)


def _no_surer(together: Reconstruction, alone: Reconstruction, is_unseen: BoolArray) -> Reconstruction:
    """Return a map whose standard deviation where neither scans nor images see is at least that without images.

    Images see crests and slopes that face them; a kernel fitted to these is too sure of the ground behind.
    """
    std = np.where(is_unseen, np.fmax(together.std.elevation, alone.std.elevation), together.std.elevation)
    return replace(together, std=Dem.on(together.std.grid(), std, together.std.vertical_datum))
