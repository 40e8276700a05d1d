"""Localize recorded drives, clean and with faults: ``python -m benchmarks.real_drives``.

The drives are the folders ``seq_*`` of the shared data: a camera on a car, with reference poses.
Every image fault is localized with the fixes of one receiver (1 Hz, bias 1 m with 120 s, white
0.5 m), and every receiver with the clean images. A case is drawn three times with other errors of
the receiver; the rows are means over the draws. Rows that begin with fresh are of other recordings
made of the same drives. A case holds where the path is not worse than the fixes alone (interpolated
linearly) by more than 10 % and the normalised squared error of the horizontal position, 2 for true
covariances, is at most 6, or where the run ends with an error whose message names the fault.
Settings were chosen with draws 100 to 104; draws 0 to 2 judge.

Odometry is processed once per set of images. Rows of a case are stored in the system's folder for
temporary files for as long as the code stays the same, so that a run that was stopped goes on where
it was. Errors are over the poses between the first and the last fix.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.real_drives.cases import (
    ALONE,
    CASES,
    CLEAN_CASES,
    FRESH_CASES,
    FRESH_DRIVES,
    Case,
    Change,
)
from benchmarks.real_drives.drives import (
    drive_folders,
    opened,
    reference_places,
    reference_times,
    shifted_image,
    travel_m,
)
from benchmarks.real_drives.receivers import in_world
from benchmarks.report import Row, main
from benchmarks.stored_parts import parts_folder, stored_rows
from survey.core.arrays import FloatArray
from survey.core.errors import FirnlineError
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes
from vision_slam.drive_estimate import DriveEstimate
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.pipeline import localize
from vision_slam.readers.sequence import GpsLog, ImageSequence, georeference

DRAWS = range(3)
UTM = "EPSG:32632"
_SHIFT_PX, _N_SHIFTED = 0.25, 121


@dataclass(frozen=True)
class Outcome:
    """Horizontal errors of one case [m], the mean normalised squared error, and the message that ended it."""

    rms_m: float = np.nan
    end_m: float = np.nan
    squared: float = np.nan
    fixes_rms_m: float = np.nan
    ended: str = ""


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows, of short drives first."""
    folders = drive_folders()
    if not folders:
        sys.exit("the recorded drives are not here; set FIRNLINE_DATA.")
    draws, parts = DRAWS[:1] if quick else DRAWS, parts_folder("real-drives", "benchmarks/real_drives")
    drives = {name: opened(folder) for name, folder in folders.items()}
    ordered = sorted(drives, key=lambda name: len(drives[name].frames))
    for name in ordered[: 1 if quick else None]:
        drive = _Drive(name, drives[name])
        for index, alone in enumerate(ALONE):
            yield from stored_rows(parts / f"{name}-alone-{index}.json", partial(_alone, drive, *alone))
        yield from stored_rows(parts / f"{name}-shifted.json", partial(_shifted, drive))
        for index, case in enumerate(CASES):
            part = parts / f"{name}-{index}-{len(draws)}.json"
            yield from stored_rows(part, partial(_with_fixes, drive, case, draws))
    if not quick:
        for name in ordered:
            yield from _fresh(_Drive(f"fresh, {name}", drives[name]), draws, parts)


def _fresh(drive: "_Drive", draws: range, parts: Path) -> Iterator[Row]:
    """Yield the rows of other recordings made of a drive."""
    made = [_Drive(f"{drive.name} {name}", change(drive.sequence)) for name, change in FRESH_DRIVES]
    cases = [(drive, case) for case in FRESH_CASES]
    cases += [(other, case) for other in made for case in CLEAN_CASES]
    for index, (other, case) in enumerate(cases):
        part = parts / f"{drive.name}-{index}.json"
        yield from stored_rows(part, partial(_with_fixes, other, case, draws))


@dataclass(frozen=True)
class _Drive:
    """A drive, and what its images gave for each change."""

    name: str
    sequence: ImageSequence
    processed: dict[Change, tuple[ImageSequence, VisualOdometry | str]] = field(default_factory=dict)

    def visual(self, change: Change) -> tuple[ImageSequence, VisualOdometry | str]:
        """Return the changed images and their odometry, or the message that refuses them."""
        if change not in self.processed:
            changed = change(self.sequence)
            self.processed[change] = changed, _processed(changed)
        return self.processed[change]


def _alone(drive: _Drive, case: str, change: Change, bar: float) -> list[Row]:
    """Return the end error without fixes."""
    _, visual = drive.visual(change)
    row = f"{drive.name}: {case}, end error"
    if isinstance(visual, str):
        print(f"  {row}: {visual}", file=sys.stderr)
        return [Row(row, float("nan"), "%", f"<= {bar:g}", holds=False)]
    off = DriveEstimate.in_first_frame(visual).position - reference_places(drive.sequence)
    end = 100.0 * float(np.linalg.norm(off[-1] - off[0]) / travel_m(drive.sequence)[-1])
    return [Row.of(row, end, "%", "<=", bar)]


def _shifted(drive: _Drive) -> list[Row]:
    """Return the heading of a shifted image over that of its shift."""
    found = visual_odometry(shifted_image(drive.sequence, _SHIFT_PX, _N_SHIFTED))
    heading = np.unwrap(found.odometry.attitude_rad[:, 2])
    expected = np.arctan(_SHIFT_PX * (_N_SHIFTED - 1) / drive.sequence.camera.matrix[0, 0])
    ratio = float((heading[-1] - heading[0]) / expected)
    name = f"{drive.name}: shifted by 0.25 px a frame, heading found over true"
    return [Row(name, ratio, "1", "0.95 to 1.05", abs(ratio - 1.0) <= 0.05)]


def _with_fixes(drive: _Drive, case: Case, draws: range) -> list[Row]:
    """Return the rows of a case with fixes."""
    changed, visual = drive.visual(case.change)
    outcomes = [_outcome(case, drive.sequence, changed, visual, draw) for draw in draws]
    return list(_rows(f"{drive.name}: {case.name}", case, outcomes))


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
        stated = case.receiver.config() if case.is_stated else None
        found = localize(recording, stated, visual=visual).trajectory
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
