"""Cases of the benchmark of recorded drives: changes of the images and receivers beside them."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.real_drives.drives import (
    with_drops,
    with_focal_error,
    with_gap,
    with_swaps,
    with_undeclared_distortion,
    with_wheels,
)
from benchmarks.real_drives.fresh import (
    halved,
    mirrored,
    reversed_in_time,
    with_passing_patch,
    with_repeated_images,
)
from benchmarks.real_drives.receivers import (
    GPS,
    LATE,
    PHONE,
    RTK,
    RTK_10_HZ,
    SCATTERED,
    SCATTERED_5_HZ,
    Receiver,
)
from vision_slam.readers.sequence import ImageSequence, scale_by_reference

Change = Callable[[ImageSequence], ImageSequence]


@dataclass(frozen=True)
class Case:
    """A change of the images, the receiver beside them, and words of the message that may end the run.

    `is_stated`: whether the user states the errors of the receiver.
    """

    name: str
    change: Change
    receiver: Receiver = GPS
    reasons: tuple[str, ...] = ()
    is_stated: bool = True


def clean(sequence: ImageSequence) -> ImageSequence:
    """Leave the images as they are."""
    return sequence


EXACT_WHEELS, WRONG_WHEELS = with_wheels(1.0), with_wheels(1.03)
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
    Case("3 m, nothing stated", clean, SCATTERED, is_stated=False),
    Case("3 m at 5 Hz, nothing stated", clean, SCATTERED_5_HZ, is_stated=False),
    Case("fixes 0.5 s late", clean, LATE, ("time", "clock")),
    Case("exact wheels and fixes", EXACT_WHEELS),
    Case("wheels 3 % off and fixes", WRONG_WHEELS),
)
# Other recordings made of the same drives. Repeated images were cured on the shortest, small images on the turn.
FRESH_CASES = (
    Case("half the resolution", halved),
    Case("half the resolution, RTK 1 Hz", halved, RTK),
    Case("three repeated images", with_repeated_images),
    Case("three repeated images, RTK 1 Hz", with_repeated_images, RTK),
    Case("a fifth hidden by what passes by", with_passing_patch),
)
CLEAN_CASES = tuple(case for case in CASES if case.name in ("clean", "RTK 1 Hz"))
FRESH_DRIVES = (("mirrored", mirrored), ("backwards", reversed_in_time))
# Without fixes: end error in per cent of the way, and its bar.
ALONE: tuple[tuple[str, Change, float], ...] = (
    ("scale from 10 m", lambda sequence: scale_by_reference(sequence, 10.0), 3.0),
    ("exact wheels", EXACT_WHEELS, 1.0),
    ("wheels 3 % off", WRONG_WHEELS, 4.0),
)
