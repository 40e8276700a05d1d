"""The scale of a drive without wheels, from its fixes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors import GpsFixes
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from vision_slam.config import LocalizationConfig
from vision_slam.odometry.scale_drift import resized
from vision_slam.odometry.visual_slam import VisualOdometry
from vision_slam.pipeline import (
    dead_reckoning,
    for_images,
    localize,
    localize_by_images,
    with_visual_odometry,
)

_LONG_ENOUGH_M = 20.0
_FIX_M = 3.0  # error of a receiver without corrections, which the scale inherits


def localize_images(
    recording: Recording,
    config: LocalizationConfig | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    *,
    told_online: Callable[[Trajectory], None] | None = None,
) -> tuple[Trajectory, SurfacePoints, VisualOdometry]:
    """Localize images with fixes; without wheels, one camera's path is first scaled to the fixes.

    Raises
    ------
    InputError
        No images, fewer than two, no landmarks, or fixes that spread over less than 20 m
        and no wheels.
    """
    if recording.wheels is not None:
        return localize_by_images(recording, config, progress, told_online=told_online)
    _refuse_short(recording)
    seen, found = with_visual_odometry(recording, progress=progress)
    refuse_blind(found)
    assert seen.odometry is not None
    path = dead_reckoning(seen.odometry, recording.start)
    factor, sigma = scale_by_fixes(path, seen.odometry.time_s, recording.gps)
    settings = for_images(config or LocalizationConfig())
    settings = settings.model_copy(update={"scale_sigma": max(settings.scale_sigma, sigma)})
    found = scaled(found, factor)
    seen = replace(seen, odometry=found.odometry, sightings=found.sightings)
    trajectory, points = localize(seen, settings, told_online=told_online)
    return replace(trajectory, health=1.0 - found.is_lost), points, found


def scale_by_fixes(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> tuple[float, float]:
    r"""Return by how much a path (N, 3) must grow to be as large as its fixes, and the relative error of that.

    Of the similarities of the plane, the one with the least squared misfit: with path z
    and fixes g as complex numbers about their means, its factor is

    .. math:: s = |Σ g \bar z| / Σ |z|²

    Examples
    --------
    >>> time_s = np.arange(50.0)
    >>> path = np.column_stack([time_s, 0.1 * time_s, np.zeros(50)])
    >>> round(scale_by_fixes(path, time_s, GpsFixes(time_s, 2.5 * path))[0], 6)
    2.5
    """
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    x, y = (np.interp(gps.time_s[inside], time_s, path[:, axis]) for axis in (0, 1))
    z, g = x + 1j * y, gps.position[inside, 0] + 1j * gps.position[inside, 1]
    z, g = z - z.mean(), g - g.mean()
    size = float((np.abs(z) ** 2).sum())
    factor = float(np.abs((g * z.conj()).sum())) / max(size, 1e-12)
    # Fixes a minute apart err alike: the spread of the fixes counts, not their number.
    return factor, _FIX_M / max(float(np.sqrt((np.abs(g) ** 2).mean())), 1e-12)


def scaled(found: VisualOdometry, factor: float) -> VisualOdometry:
    """Return the same motion and landmarks, `factor` times as large."""
    o = found.odometry
    unseen_m = None if o.step_sigma_m is None else factor * o.step_sigma_m
    return replace(
        found,
        odometry=replace(o, step=factor * o.step, step_sigma_m=unseen_m),
        sightings=resized(found.sightings, np.full(len(o.time_s), factor)),
    )


def refuse_blind(found: VisualOdometry) -> None:
    """Refuse images of which not one could be followed: without wheels their motion would be invented.

    Raises
    ------
    InputError
        No image but the first has a pose of its own.
    """
    if not any(frame.is_visual for frame in found.health[1:]):
        raise InputError(
            f"none of {len(found.health)} images could be followed from the one before, and no wheels tell the motion; "
            "they may be blank, too far apart, or of another camera than the calibration."
        )


def _refuse_short(recording: Recording) -> None:
    """Refuse fixes that cannot tell a scale, before images are looked at."""
    assert recording.frames is not None
    first, last = recording.frames.time_s[[0, -1]]
    inside = (recording.gps.time_s >= first) & (recording.gps.time_s <= last)
    spread = float(np.linalg.norm(np.ptp(recording.gps.position[inside, :2], axis=0)))
    if spread < _LONG_ENOUGH_M:
        raise InputError(
            f"the fixes spread over {spread:.1f} m, and no wheels tell the scale of the images; "
            f"at least {_LONG_ENOUGH_M:.0f} m are needed, or a table wheels.csv."
        )
