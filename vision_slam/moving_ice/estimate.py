"""Localization on moving ice: path, landmarks and motion of the ice in one estimate, at an epoch."""

import numpy as np

from survey.core.arguments import check_types
from survey.core.arrays import FloatArray, Progress
from survey.data.ice.motion import IceMotion
from survey.data.recording import Recording
from survey.reconstruction.motion.epoch import in_ice_frame
from survey.reconstruction.motion.stakes import motion_with_stakes
from vision_slam.config import LocalizationConfig
from vision_slam.localization import Localization
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.pipeline import localize, process_images

# Checks of start, gates and memory of the fixes take the motion for exact: they are repeated about the motion that was
# found where this moves a fix by more than this share of its claimed error.
_CLOSE = 0.1
_MOST_PASSES = 4


@check_types
def localize_on_ice(
    recording: Recording,
    motion: IceMotion,
    config: LocalizationConfig | None = None,
    *,
    visual: VisualOdometry | None = None,
    progress: Progress | None = None,
) -> Localization:
    """Estimate the path of a rover on moving ice, its landmarks and the motion of the ice.

    Parameters
    ----------
    recording : Recording
        Records of one drive, in fixed coordinates; repeated surveys of stakes count as measurements of the motion.
    motion : IceMotion
        Prior of the motion, with the epoch.
    config : LocalizationConfig, optional
        Errors assumed of the sensors.
    visual : VisualOdometry, optional
        Visual odometry of the images of this recording; computed where left out.
    progress : callable, optional
        Progress callback (stage, done, total) of the images.

    Returns
    -------
    Localization
        Path and landmarks at the epoch, and `Localization.ice_motion`. A place of the path at its own time is that of
        the epoch plus `IceMotion.displacement`.

    Raises
    ------
    InputError
        As `vision_slam.localize`.
    """
    settings = config or LocalizationConfig()
    if visual is None and recording.odometry is None and recording.frames is not None:
        visual = process_images(recording, None, progress)
    if recording.stake_surveys is not None:
        motion = motion_with_stakes(motion, recording.stake_surveys)
    about = motion.about(motion.expected)
    for _ in range(_MOST_PASSES):
        reduced = in_ice_frame(recording, about)
        found = localize(reduced, settings, visual=visual)
        if found.ice_motion is None or _most_moved_m(
            about, found.ice_motion, recording
        ) < _CLOSE * _claimed_m(settings):
            break
        about = about.about(_unknowns(about, found.ice_motion))
    return found


def _unknowns(about: IceMotion, found: IceMotion) -> FloatArray:
    """Return the unknowns (R,) that lead from one estimate to another with the same modes."""
    apart = (found.coefficients - about.coefficients).ravel()
    return np.asarray(np.linalg.lstsq(about.modes, apart)[0], dtype=np.float64)


def _most_moved_m(about: IceMotion, found: IceMotion, recording: Recording) -> float:
    """Return how far the motion that was found moves a fix from where it was taken to be, at most [m]."""
    ends = recording.gps.time_s[[0, -1]]
    places = recording.gps.position[[0, -1], :2]
    apart = found.displacement(places, ends) - about.displacement(places, ends)
    return float(np.abs(apart).max())


def _claimed_m(config: LocalizationConfig) -> float:
    return float(np.hypot(config.gps_bias_sigma_m, config.gps_white_sigma_m))
