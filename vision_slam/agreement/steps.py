"""Steps of the pipeline that bring odometry and fixes into agreement.

Each step takes a `Drive`, a recording with odometry and the results of earlier steps, and returns one; `STEPS` is their
order. What a step changes is stated in a note.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from survey.core import BoolArray
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.drive import MANY_REFUSED, Drive
from vision_slam.agreement.evidence import (
    Agreement,
    agrees_better_delayed,
    along_fixes,
    fitted_memory_s,
    fitted_turn_sigma_m,
    is_worse_than_fixes,
    reconcile,
    white_error_m,
)
from vision_slam.agreement.sanity_checks import check_start_by_fixes, fix_delay_s, remove_repeated_fixes
from vision_slam.agreement.scale import fit_scale, refuse_other_wheel_scale, scale_visual_odometry, tilt_note
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import gate_fixes, select_fixes
from vision_slam.fusion.smoother import SmoothedPath, smooth
from vision_slam.motion import GAP_S, dead_reckoning
from vision_slam.places.loop_closures import detect_loop_closures
from vision_slam.places.relocalization import align_heading

_CLOCK_SIGMAS = 2.0
_SCATTERED = 1.5  # scatter of fixes over the assumed independent error, beyond which it is used
_FARTHEST_M = 1e5  # farther than a rover drives in one recording


def drop_far_fixes(drive: Drive) -> Drive:
    """Remove fixes more than 100 km from the median of all, which no odometry explains; note how many.

    A start that was not surveyed is the first remaining fix where it is as far away.
    """
    gps, start = drive.recording.gps, drive.recording.start
    middle = np.median(gps.position, axis=0)
    is_near = np.hypot(*(gps.position - middle)[:, :2].T) < _FARTHEST_M
    n = int((~is_near).sum())
    if n == 0 or is_near.sum() < gps.LEAST:
        return drive
    near = gps.select(is_near)
    if not drive.recording.start_is_surveyed and np.hypot(*(start - middle)[:2]) >= _FARTHEST_M:
        start = near.position[0]
    dropped = replace(drive, recording=replace(drive.recording, gps=near, start=start))
    return dropped.noted(f"{n} fixes lie more than 100 km from the others and were left out")


def drop_repeated_fixes(drive: Drive) -> Drive:
    """Remove fixes that repeat the one before to the last digit."""
    gps = remove_repeated_fixes(drive.recording.gps)
    n = len(drive.recording.gps) - len(gps)
    if n == 0:
        return drive
    dropped = replace(drive, recording=replace(drive.recording, gps=gps))
    return dropped.noted(f"{n} fixes repeat the one before to the last digit and were left out")


def drop_fixes_in_gaps(drive: Drive) -> Drive:
    """Remove fixes in gaps of the images that neither wheels nor gyro bridge, where no pose lies."""
    path_s, is_gap = drive.recording.odometry.time_s, _gaps(drive.recording.odometry)
    if not is_gap.any():
        return drive
    time_s = drive.recording.gps.time_s
    step = np.clip(np.searchsorted(path_s, time_s) - 1, 0, len(is_gap) - 1)
    inside = is_gap[step] & (time_s > path_s[step]) & (time_s < path_s[step + 1])
    without = replace(drive, recording=select_fixes(drive.recording, ~inside))
    return without.noted(
        f"nothing bridges {int(is_gap.sum())} gaps between images (the longest of {np.diff(path_s)[is_gap].max():.1f} s); the "
        f"path is not estimated there, and {int(inside.sum())} fixes within were left out"
    )


def widen_white_errors(drive: Drive) -> Drive:
    """Take a larger independent error of the fixes where they scatter so about the path and nobody states their errors.

    Odometry would be blamed for it otherwise.
    """
    recording, config = drive.recording, drive.config
    is_stated = recording.gps.sigma_m is not None or "gps_white_sigma_m" in config.model_fields_set
    if is_stated or recording.start_is_surveyed:
        return drive
    found_m = white_error_m(recording, drive.path)
    if found_m is None or found_m <= _SCATTERED * config.gps_white_sigma_m:
        return drive
    widened = replace(drive, config=config.model_copy(update={"gps_white_sigma_m": found_m}))
    return widened.noted(
        f"the fixes scatter by {found_m:.1f} m (1 σ) from second to second, {found_m / config.gps_white_sigma_m:.0f} times what "
        "was assumed: this error was used; --set localization.gps_white_sigma_m states it"
    )


def _gaps(odometry: Odometry) -> BoolArray:
    """Return which steps (N - 1,) of the odometry are unmeasured and too long for the fixes within."""
    if odometry.step_sigma_m is None:
        return np.zeros(len(odometry.step), dtype=np.bool_)
    return (odometry.step_sigma_m > 0.0) & (np.diff(odometry.time_s) > GAP_S)


def _of_longest_run(odometry: Odometry, gps: GpsFixes) -> GpsFixes:
    """Return the fixes of the run of images without gaps over which they spread most; all of them without gaps."""
    ends = np.r_[odometry.time_s[:-1][_gaps(odometry)], odometry.time_s[-1]]
    run = np.searchsorted(ends, gps.time_s)
    spread = [
        np.ptp(gps.position[run == k], axis=0).max(initial=0.0) if (run == k).any() else 0.0
        for k in range(len(ends))
    ]
    return gps.select(run == int(np.argmax(spread)))


def scale_to_fixes(drive: Drive) -> Drive:
    """Scale visual odometry without wheels to the extent of the fixes."""
    if drive.visual is None or not drive.has_images or drive.recording.wheels is not None:
        return drive
    gps = _of_longest_run(drive.visual.odometry, drive.recording.gps)
    factor, sigma = fit_scale(drive.visual, drive.recording.start, gps)
    scaled = scale_visual_odometry(drive.visual, factor)
    widened = drive.config.model_copy(update={"scale_sigma": max(drive.config.scale_sigma, sigma)})
    recording = drive.recording.with_odometry(scaled.odometry, scaled.sightings)
    return replace(drive, recording=recording, config=widened, visual=scaled)


def check_shape(drive: Drive) -> Drive:
    """Refuse wheels of another scale and a camera that is tilted far from its mounting, by the extent of the fixes.

    A smaller tilt is noted.
    """
    if drive.visual is None or drive.is_interrupted:
        return drive
    shapes = (drive.path, drive.recording.odometry.time_s, drive.recording.gps, drive.config)
    if drive.recording.wheels is not None or not drive.has_images:
        refuse_other_wheel_scale(*shapes)
    note = tilt_note(*shapes) if drive.has_images else None
    return drive if note is None else drive.noted(note)


def check_start(drive: Drive) -> Drive:
    """Take a surveyed start for unknown where the fixes contradict it."""
    if drive.is_interrupted:
        return drive
    time_s = drive.recording.odometry.time_s
    recording, config = check_start_by_fixes(drive.recording, drive.path, time_s, drive.config)
    if recording is drive.recording:
        return drive
    off_m = float(np.hypot(*(recording.start - drive.recording.start)[:2]))
    moved = replace(drive, recording=recording, config=config)
    return moved.noted(f"the fixes put the start {off_m:.0f} m from where it was surveyed")


def align_drive(drive: Drive) -> Drive:
    """Align the heading of visual odometry with the fixes; recorded odometry has a heading already."""
    if drive.visual is None:
        return drive
    recording, visual = align_heading(drive.recording, drive.visual)
    return replace(drive, recording=recording, visual=visual)


def correct_delay(drive: Drive) -> Drive:
    """Move delayed fixes back in time, and fixes of a clock that is ahead on in time.

    Fixes that were refused count only if most of them are accepted after the shift.
    """
    if drive.is_interrupted:
        return drive
    one_clock = drive.config.model_copy(update={"clock_sigma_s": 0.0})
    least_s = _CLOCK_SIGMAS * drive.config.clock_sigma_s  # what is less is estimated with the path
    delay_s = fix_delay_s(gate_fixes(drive.recording, drive.online), drive.path, one_clock)
    if abs(delay_s) > least_s and agrees_better_delayed(drive.recording, drive.path, one_clock, delay_s):
        return _shifted(drive, delay_s)
    if drive.online.n_refused < MANY_REFUSED:
        return drive
    delay_s = fix_delay_s(drive.recording, drive.path, one_clock)
    if abs(delay_s) <= least_s or not agrees_better_delayed(drive.recording, drive.path, one_clock, delay_s):
        return drive
    moved = _shifted(drive, delay_s)
    return moved if moved.online.n_refused <= 0.5 * drive.online.n_refused else drive


def _shifted(drive: Drive, delay_s: float) -> Drive:
    """Return the drive with its fixes earlier by so much, and aligned with them."""
    gps = replace(drive.recording.gps, time_s=drive.recording.gps.time_s - delay_s)
    moved = align_drive(replace(drive, recording=replace(drive.recording, gps=gps)))
    late = "late and were moved back" if delay_s > 0.0 else "early and were moved on"
    moved = replace(moved, undelayed=drive)
    return moved.noted(f"the fixes are about {abs(delay_s):.1f} s {late} in time")


def widen_errors(drive: Drive) -> Drive:
    """Widen the errors of the odometry where it and the fixes disagree beyond both claims.

    Images of others, of which not even lens and mounting are certain, may be worse than none. A delay of the fixes
    that was found with such images is undone.
    """
    if drive.is_interrupted:
        return drive
    is_foreign = drive.visual is not None and not drive.recording.start_is_surveyed
    agreement = reconcile(drive.recording, drive.path, drive.config, drive.online)
    if is_foreign and drive.online.n_fixes > agreement.used.sum():
        agreement = _with_all_fixes(drive, agreement)
    if np.array_equal(agreement.used, drive.online.accepted) and agreement.gain == 0.0:
        return drive
    if is_foreign and is_worse_than_fixes(drive.recording, drive.path, agreement.config):
        return follow_fixes(drive) if drive.undelayed is None else widen_errors(drive.undelayed)
    widened = replace(drive, config=agreement.config, used=agreement.used)
    return widened if agreement.gain == 0.0 else widened.noted(agreement.note)


def _with_all_fixes(drive: Drive, agreement: Agreement) -> Agreement:
    """Use the refused fixes too where they agree with their neighbours better than with the odometry."""
    if not is_worse_than_fixes(drive.recording, drive.path, agreement.config):
        return agreement
    fix_s, path_s = drive.recording.gps.time_s, drive.recording.odometry.time_s
    inside = (fix_s >= path_s[0]) & (fix_s <= path_s[-1])
    return reconcile(drive.recording, drive.path, drive.config, replace(drive.online, accepted=inside))


def follow_fixes(drive: Drive) -> Drive:
    """Replace odometry that predicts the fixes worse than their neighbours do by lines between them."""
    recording, config = along_fixes(drive.recording, drive.config)
    followed = replace(drive, recording=recording, config=config, follows_fixes=True)
    advice = "check the units of wheels and gyro, and times"
    if drive.has_images:
        advice = "and landmarks are not to be mapped: check focal length, lens distortion, order of the images and times"
    return followed.noted(
        "odometry and fixes disagree so much that lines between the fixes predict them better; the path is that of the fixes, "
        + advice
    )


def note_delay(drive: Drive, path: SmoothedPath) -> Drive:
    """Note the estimated delay of the fixes where it, or its standard deviation along the path, exceeds half their errors."""
    is_foreign = drive.visual is not None and not drive.recording.start_is_surveyed
    if is_foreign and "clock_sigma_s" not in drive.config.model_fields_set:
        return drive.noted(
            "fixes of centimetres were taken to have the clock of the images; set localization.clock_sigma_s where they "
            "have one of their own"
        )
    time_s, step = drive.recording.odometry.time_s, drive.recording.odometry.step
    speed_m_s = float(np.linalg.norm(step, axis=1).sum() / (time_s[-1] - time_s[0]))
    if max(abs(path.delay_s), path.delay_sigma_s) * speed_m_s <= 0.5 * drive.config.fix_sigma_m:
        return drive
    return drive.noted(
        f"the offset between the clocks of fixes and images is {path.delay_s:.2f} ± {path.delay_sigma_s:.2f} s, "
        f"{path.delay_sigma_s * speed_m_s:.1f} m along the path, which its standard deviations contain; set "
        "localization.clock_sigma_s where it is known better"
    )


def drop_refused_fixes(drive: Drive) -> Drive:
    """Remove the fixes that contradict the odometry and all other fixes."""
    return replace(drive, recording=select_fixes(drive.recording, drive.used_fixes), used=None, ungated=drive)


def fit_memory(drive: Drive) -> Drive:
    """Take a longer correlation time of the fixes' errors where the evidence asks for it."""
    assumed_s = drive.config.gps_correlation_time_s
    memory_s = fitted_memory_s(drive.recording, drive.path, drive.config)
    if memory_s == assumed_s:
        return drive
    longer = drive.config.model_copy(update={"gps_correlation_time_s": memory_s})
    note = f"the errors of the fixes last longer than the {assumed_s:g} s assumed; {memory_s:g} s was used"
    return replace(drive, config=longer).noted(note)


def fit_turn_errors(drive: Drive) -> Drive:
    """Take a smaller error of turns for the images of others where precise fixes show it."""
    if drive.visual is None or drive.recording.start_is_surveyed:
        return drive
    smaller_m = fitted_turn_sigma_m(drive.recording, drive.path, drive.config)
    return replace(drive, config=drive.config.model_copy(update={"turn_sigma_m": smaller_m}))


def add_loop_closures(drive: Drive) -> Drive:
    """Add the loop closures of the images, unless the recording has loop closures."""
    return replace(drive, recording=with_loop_closures(drive.recording, drive.config))


def with_loop_closures(recording: OdometryRecording, config: LocalizationConfig) -> OdometryRecording:
    """Return the recording with the loop closures of its images, unless it has some."""
    if recording.frames is None or recording.loop_closures is not None:
        return recording
    path = smooth(recording, dead_reckoning(recording.odometry, recording.start), config)
    sigma_m = np.sqrt(np.linalg.eigvalsh(path.covariance[:, :2, :2])[:, -1])
    return replace(recording, loop_closures=detect_loop_closures(recording, path.position, sigma_m))


STEPS: tuple[Callable[[Drive], Drive], ...] = (
    drop_far_fixes,
    drop_repeated_fixes,
    drop_fixes_in_gaps,
    widen_white_errors,
    check_shape,
    scale_to_fixes,
    check_start,
    align_drive,
    correct_delay,
    widen_errors,
    drop_refused_fixes,
    fit_memory,
    fit_turn_errors,
    add_loop_closures,
)
"""From measured motion to what the batch smoother takes.

Far and repeated fixes are removed before anything is fitted to fixes, and their own scatter is known before odometry is
blamed. The scale is fitted before start and heading, and
these before the delay, whose evidence takes the path as aligned. Memory and turn errors are fitted to the fixes that remain.
"""
