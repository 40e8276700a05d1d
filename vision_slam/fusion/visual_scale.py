"""Scale of visual odometry without wheels, from the extent of the fixes."""

from dataclasses import replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.sensors.aiding import GpsFixes
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.scale.scale_drift import scale_sightings
from vision_slam.rotation import rotations

_LEAST_SPREAD_M = 20.0
_ROUNDS = 5  # each leaves an error of the lever arm over the extent of the fixes
_FIX_ERROR_M = 3.0  # error of a receiver without corrections, which the scale inherits


def scale_by_fixes(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> tuple[float, float]:
    r"""Estimate the factor that scales a path to its fixes.

    It is the factor of the similarity of the plane with the least squared misfit. With the
    path z and the fixes g as complex numbers about their means,

    .. math:: s = |Σ g \bar z| / Σ |z|²

    Parameters
    ----------
    path : (N, 3) ndarray
        Positions in any unit and under any heading.
    time_s : (N,) ndarray
        Their times [s].
    gps : GpsFixes
        Fixes; those outside the times of the path are ignored.

    Returns
    -------
    factor : float
        Metres per unit of the path.
    sigma : float
        Relative error of the factor.

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
    # The errors of fixes a minute apart are correlated: the spread of the fixes counts, not their number.
    return factor, _FIX_ERROR_M / max(float(np.sqrt((np.abs(g) ** 2).mean())), 1e-12)


def fit_scale(visual: VisualOdometry, start: FloatArray, gps: GpsFixes) -> tuple[float, float]:
    """Estimate the factor that scales visual odometry to fixes of the body.

    The path of the body is that of the camera times the factor, less the lever arm in metres: the factor is
    found by fixed-point iteration.

    Parameters
    ----------
    visual : VisualOdometry
        Motion in any unit.
    start : (3,) ndarray
        Position of the body at the first image [m].
    gps : GpsFixes
        Fixes; those outside the times of the path are ignored.

    Returns
    -------
    factor : float
        Metres per unit of the path.
    sigma : float
        Relative error of the factor.
    """
    time_s = visual.odometry.time_s
    factor, sigma = scale_by_fixes(dead_reckoning(visual.odometry, start), time_s, gps)
    for _ in range(0 if visual.lever_arm_m is None else _ROUNDS):
        of_body = dead_reckoning(scale_visual_odometry(visual, factor).odometry, start)
        change, sigma = scale_by_fixes(of_body, time_s, gps)
        factor *= change
    return factor, sigma


def scale_visual_odometry(visual: VisualOdometry, factor: float) -> VisualOdometry:
    r"""Return the motion of the body and its landmarks with all lengths multiplied by a factor.

    Where steps s and offsets of sightings x are those of a camera with the lever arm a, they become those of
    the body:

    .. math:: s_k' = f s_k + a - R_k^T R_{k+1} a, \qquad x' = f x + a

    Parameters
    ----------
    visual : VisualOdometry
        Motion and landmarks.
    factor : float
        New over old length.

    Returns
    -------
    VisualOdometry
        Health and times are unchanged.
    """
    o = visual.odometry
    step, sightings = factor * o.step, scale_sightings(visual.sightings, np.full(len(o.time_s), factor))
    arm = visual.lever_arm_m
    if arm is not None:
        turn = rotations(o.attitude_rad)
        step = step + arm - np.einsum("nji,njk,k->ni", turn[:-1], turn[1:], arm)
        sightings = replace(sightings, offset=sightings.offset + arm)
    step_sigma_m = None if o.step_sigma_m is None else factor * o.step_sigma_m
    odometry = replace(o, step=step, step_sigma_m=step_sigma_m)
    return replace(visual, odometry=odometry, sightings=sightings, lever_arm_m=None)


def refuse_untracked(visual: VisualOdometry) -> None:
    """Refuse images of which not one could be tracked: without wheels their motion is unknown.

    Raises
    ------
    InputError
        No image but the first has a pose of its own.
    """
    if not any(frame.is_visual for frame in visual.health[1:]):
        raise InputError(
            f"none of {len(visual.health)} images could be followed from the one before, and there are no wheels; "
            "they may be blank, too far apart, or of another camera than the calibration."
        )


def refuse_short_fixes(gps: GpsFixes, time_s: FloatArray) -> None:
    """Refuse fixes whose extent during the images cannot give a scale.

    Raises
    ------
    InputError
        They spread over less than 20 m.
    """
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    spread = float(np.linalg.norm(np.ptp(gps.position[inside, :2], axis=0))) if inside.any() else 0.0
    if spread < _LEAST_SPREAD_M:
        raise InputError(
            f"the fixes spread over {spread:.1f} m, and without wheels they give the scale of the images; "
            f"at least {_LEAST_SPREAD_M:.0f} m are needed, or a table wheels.csv."
        )
