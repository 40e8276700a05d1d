"""Localize recorded drives, clean and with faults: ``python -m benchmarks.real_drives``.

The drives are the folders ``seq_*`` of the shared data: a camera on a car, with reference poses.
Every image fault is localized with the fixes of one receiver (1 Hz, bias 1 m with 120 s, white
0.5 m), and every receiver with the clean images. A case is drawn three times with other errors of
the receiver; the rows are means over the draws. It holds where the path is not worse than the
fixes alone (interpolated linearly) by more than 10 % and the normalised squared error of the
horizontal position, 2 for true covariances, is at most 6, or where the run ends with an error
whose message names the fault. Settings were chosen with draws 100 to 104; draws 0 to 2 judge.

Odometry is processed once per set of images. Errors are over the poses between the first and
the last fix.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.real_drives.drives import (
    drive_folders,
    opened,
    reference_places,
    reference_times,
    shifted_image,
    travel_m,
    with_drops,
    with_focal_error,
    with_gap,
    with_swaps,
    with_undeclared_distortion,
    with_wheels,
)
from benchmarks.real_drives.receivers import GPS, LATE, PHONE, RTK, RTK_10_HZ, Receiver, in_world
from benchmarks.report import Row, main
from survey.core.arrays import FloatArray
from survey.core.errors import FirnlineError
from survey.data.recording import Recording
from survey.data.sensors.aiding import GpsFixes
from vision_slam.io.gps_files import GpsLog
from vision_slam.io.sequence import ImageSequence, georeference, scale_by_reference
from vision_slam.odometry.visual_odometry import VisualOdometry, visual_odometry
from vision_slam.pipeline import localize
from vision_slam.recorded_drive import RecordedDrive

DRAWS = range(3)
UTM = "EPSG:32632"
_SHIFT_PX, _N_SHIFTED = 0.25, 121

Change = Callable[[ImageSequence], ImageSequence]


@dataclass(frozen=True)
class Case:
    """A change of the images, the receiver beside them, and words of the message that may end the run."""

    name: str
    change: Change
    receiver: Receiver = GPS
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """Horizontal errors of one case [m], the mean normalised squared error, and the message that ended it."""

    rms_m: float = np.nan
    end_m: float = np.nan
    squared: float = np.nan
    fixes_rms_m: float = np.nan
    ended: str = ""


def clean(sequence: ImageSequence) -> ImageSequence:
    """Leave the images as they are."""
    return sequence


CASES = (
    Case("clean", clean),
    Case("1 s gap", with_gap),
    Case("10 % dropped", with_drops),
    Case("two pairs swapped", with_swaps, reasons=("order",)),
    Case("focal length +20 %", with_focal_error(1.2), reasons=("focal length",)),
    Case("focal length -20 %", with_focal_error(0.8), reasons=("focal length",)),
    Case("k1 -0.3 undeclared", with_undeclared_distortion, reasons=("distortion",)),
    Case("RTK 1 Hz", clean, RTK),
    Case("RTK 10 Hz", clean, RTK_10_HZ),
    Case("phone 1 Hz", clean, PHONE),
    Case("fixes 0.5 s late", clean, LATE, ("time", "clock")),
    Case("exact wheels and fixes", with_wheels(1.0)),
    Case("wheels 3 % off and fixes", with_wheels(1.03)),
)
# Without fixes: end error in per cent of the way, and its bar.
ALONE: tuple[tuple[str, Change, float | None], ...] = (
    ("scale from 10 m", lambda sequence: scale_by_reference(sequence, 10.0), 3.0),
    ("exact wheels", with_wheels(1.0), 1.0),
    ("wheels 3 % off", with_wheels(1.03), 4.0),
)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    folders = drive_folders()
    if not folders:
        sys.exit("the recorded drives are not here; set FIRNLINE_DATA.")
    for name, folder in list(folders.items())[: 1 if quick else None]:
        sequence = opened(folder)
        yield from _alone(name, sequence)
        yield _shifted(name, sequence)
        yield from _with_fixes(name, sequence, DRAWS[:1] if quick else DRAWS)


def _alone(name: str, sequence: ImageSequence) -> Iterator[Row]:
    """Yield the rows without fixes."""
    for case, change, bar in ALONE:
        drive = RecordedDrive(change(sequence))
        off = drive.localize().position - reference_places(sequence)
        end = 100.0 * float(np.linalg.norm(off[-1] - off[0]) / travel_m(sequence)[-1])
        row = f"{name}: {case}, end error"
        yield Row(row, end, "%") if bar is None else Row.of(row, end, "%", "<=", bar)


def _shifted(name: str, sequence: ImageSequence) -> Row:
    """Return the heading of a shifted image over that of its shift."""
    found = visual_odometry(shifted_image(sequence, _SHIFT_PX, _N_SHIFTED))
    heading = np.unwrap(found.odometry.attitude_rad[:, 2])
    expected = np.arctan(_SHIFT_PX * (_N_SHIFTED - 1) / sequence.camera.matrix[0, 0])
    ratio = float((heading[-1] - heading[0]) / expected)
    holds = abs(ratio - 1.0) <= 0.05
    return Row(
        f"{name}: shifted by 0.25 px a frame, heading found over true", ratio, "1", "0.95 to 1.05", holds
    )


def _with_fixes(name: str, sequence: ImageSequence, draws: range) -> Iterator[Row]:
    """Yield the rows of all cases with fixes; images are processed once per change."""
    processed: dict[Change, tuple[ImageSequence, VisualOdometry | str]] = {}
    for case in CASES:
        if case.change not in processed:
            changed = case.change(sequence)
            processed[case.change] = changed, _processed(changed)
        changed, visual = processed[case.change]
        outcomes = [_outcome(case, sequence, changed, visual, draw) for draw in draws]
        yield from _rows(f"{name}: {case.name}", case, outcomes)


def _processed(sequence: ImageSequence) -> VisualOdometry | str:
    """Return the odometry of images, or the message that refuses them."""
    try:
        return visual_odometry(sequence)
    except FirnlineError as error:
        return str(error)


def _outcome(
    case: Case, sequence: ImageSequence, changed: ImageSequence, visual: VisualOdometry | str, seed: int
) -> Outcome:
    """Localize a case with one draw of the receiver's errors."""
    if isinstance(visual, str):
        return Outcome(ended=visual)
    times, places = reference_times(sequence), in_world(reference_places(sequence))
    fixes = case.receiver.fixes(times, places, seed)
    recording = _recording(changed, fixes)
    try:
        found = localize(recording, case.receiver.config(), visual=visual).trajectory
    except FirnlineError as refusal:
        return Outcome(ended=str(refusal))
    judged = (found.time_s >= fixes.time_s[0]) & (found.time_s <= fixes.time_s[-1])
    real = _at(found.time_s[judged], times, places)[:, :2]
    error = found.position[judged, :2] - real
    alone = _at(found.time_s[judged], fixes.time_s, fixes.position)[:, :2] - real
    spread = found.covariance[judged, :2, :2]
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[:, :, 0])
    return Outcome(_rms(error), float(np.hypot(*error[-1])), float(squared.mean()), _rms(alone))


def _recording(sequence: ImageSequence, fixes: GpsFixes) -> Recording:
    """Combine images and fixes as the command does."""
    log = GpsLog(fixes.time_s, fixes.position, is_geodetic=False)
    return georeference(replace(sequence, reference=None, reference_time_s=None), log, UTM)


def _rows(name: str, case: Case, outcomes: list[Outcome]) -> Iterator[Row]:
    """Yield what the draws of one case show together."""
    ended = [outcome.ended for outcome in outcomes if outcome.ended]
    yield Row(f"{name}: ended", float(len(ended)), "runs")
    for message in sorted(set(ended)):
        print(f"  {name}: {message}", file=sys.stderr)
    is_right = all(any(word in message for word in case.reasons) for message in ended)
    finished = [outcome for outcome in outcomes if not outcome.ended]
    if not finished:
        yield Row(f"{name}: right reason", float(is_right), "1", ">= 1", is_right)
        return
    rms, end, squared, alone = (
        float(np.mean([getattr(outcome, part) for outcome in finished]))
        for part in ("rms_m", "end_m", "squared", "fixes_rms_m")
    )
    yield Row(f"{name}: fixes alone, rms", alone, "m")
    yield Row(f"{name}: end error", end, "m")
    is_rtk = case.receiver.white_m < 0.1
    yield Row.of(f"{name}: rms", rms, "m", "<=", 0.05) if is_rtk else Row(f"{name}: rms", rms, "m")
    yield Row.of(f"{name}: rms over that of the fixes alone", rms / alone, "1", "<=", 1.1)
    lowest, highest = (1.0, 4.0) if is_rtk else (0.0, 6.0)
    holds = lowest <= squared <= highest
    yield Row(f"{name}: NEES, 2-D", squared, "1", f"{lowest:g} to {highest:g}", holds)
    held = is_right and holds and rms <= 1.1 * alone
    yield Row(f"{name}: verdict", float(held), "1", ">= 1", held)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def _at(time_s: FloatArray, times: FloatArray, places: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(time_s, times, axis) for axis in places.T])


if __name__ == "__main__":
    main("Real drives", measure)
