"""Localization of photographs that overlap but are too far apart to follow corners from one to the next."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from survey import Recording
from survey.core import FloatArray, Progress
from vision_slam.config import LocalizationConfig
from vision_slam.drive_estimate import DriveEstimate, Localization
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.photographs.georeference import georeferenced, ray_information
from vision_slam.photographs.matches import tracks_of
from vision_slam.photographs.structure import PlacedCameras, reconstruct_cameras
from vision_slam.readers.sequence import VisionRecords

_FOLLOWED = 0.5  # share of the images followed from the one before, below which features are matched instead
_MOST = 1000  # images; matching more would take hours
_MOST_NAMED = 10


def are_far_apart(records: VisionRecords, visual: VisualOdometry) -> bool:
    """Return whether most images could not be followed from the one before, and no wheels bridge them."""
    if records.wheels is not None or records.frames is None or len(records.frames) > _MOST:
        return False
    return _n_followed(visual) < _FOLLOWED * (len(visual.health) - 1)


def _n_followed(visual: VisualOdometry) -> int:
    return sum(frame.is_visual for frame in visual.health[1:])


def localize_photographs(
    recording: Recording, config: LocalizationConfig, visual: VisualOdometry, progress: Progress | None = None
) -> Localization | None:
    """Localize photographs by the features that they share, and by their fixes.

    The order of the photographs does not matter. A lens whose distortion is not stated is estimated with them. Landmarks are
    corners of whatever the photographs show, trees and walls too.

    Returns
    -------
    Localization or None
        Path of the photographs that could be placed; none where these are fewer than visual odometry followed.
    """
    assert recording.frames is not None
    inside = np.clip(recording.frames.time_s, recording.gps.time_s[0], recording.gps.time_s[-1])
    place = np.column_stack(
        [np.interp(inside, recording.gps.time_s, axis) for axis in recording.gps.position.T]
    )
    structure = _structure(recording, place, visual, progress)
    if structure is None:
        return None
    found = georeferenced(structure, recording, config)
    return replace(found, notes=(*_notes(structure, recording), *found.notes))


def photographs_without_fixes(
    records: VisionRecords, visual: VisualOdometry, progress: Progress | None = None
) -> DriveEstimate | None:
    """Place photographs in the frame of the first one; the unit of length is the distance of two of them."""
    structure = _structure(records, None, visual, progress)
    if structure is None or records.frames is None or records.camera is None:
        return None
    mount = records.camera.T_body_camera[:3, :3]
    turn, shift = mount @ structure.poses[0, :3, :3].T, structure.poses[0, :3, 3]
    place = (structure.poses[:, :3, 3] - shift) @ turn.T
    errors = structure.errors[:, :, 3:] @ turn.T
    errors = errors - errors[:, :1]
    points, seen = (structure.points - shift) @ turn.T, structure.tracks
    rays = np.repeat(points, np.diff(seen.first), axis=0) - place[seen.keyframe]
    own = np.linalg.inv(np.add.reduceat(ray_information(structure, rays), seen.first[:-1], axis=0))
    quaternion = Rotation.from_matrix(turn @ structure.poses[:, :3, :3] @ mount.T).as_quat(canonical=True)
    return DriveEstimate(
        records.frames.time_s[structure.image],
        place,
        quaternion,
        points,
        np.sqrt(own[:, 2, 2]),
        notes=(
            *_notes(structure, records),
            "lengths have no scale: their unit is the distance of two photographs",
        ),
        own_covariance=np.einsum("ski,skj->kij", errors, errors) / len(errors),
    )


def _structure(
    records: VisionRecords, place: FloatArray | None, visual: VisualOdometry, progress: Progress | None
) -> PlacedCameras | None:
    """Place photographs by their features; None where fewer can be placed than were followed."""
    assert records.frames is not None
    assert records.camera is not None
    structure = reconstruct_cameras(tracks_of(records.frames, place, progress), records.camera, progress)
    if structure is None or len(structure.image) <= _n_followed(visual):
        return None
    return structure


def _notes(structure: PlacedCameras, records: VisionRecords) -> tuple[str, ...]:
    """Return what was done, which photographs were left out, and what lens was found."""
    assert records.frames is not None
    assert records.camera is not None
    n, placed = len(records.frames), len(structure.image)
    notes = [
        f"images are too far apart to follow corners from one to the next: {placed} of {n} were placed by features that "
        "overlapping ones share"
    ]
    left = sorted(set(range(n)) - set(structure.image.tolist()))
    if left:
        some = ", ".join(str(index + 1) for index in left[:_MOST_NAMED])
        notes.append(
            f"not placed, of the images in order of time: {some}{', …' if len(left) > _MOST_NAMED else ''}"
        )
    given, found = records.camera, structure.camera
    if given.distortion_is_assumed and not np.array_equal(given.matrix, found.matrix):
        share = 100.0 * (found.matrix[0, 0] / given.matrix[0, 0] - 1.0)
        k1, k2 = found.distortion[:2] - given.distortion[:2]
        notes.append(
            f"the lens was estimated: focal length changed by {share:.1f} %, k1 by {k1:.4f}, k2 by {k2:.4f}"
        )
    return tuple(notes)
