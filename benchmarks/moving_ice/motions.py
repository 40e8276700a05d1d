"""Velocity and lowering of many surveys, from localization alone: a map would change them little."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.moving_ice.cases import Case
from benchmarks.moving_ice.figures import share_rows
from benchmarks.moving_ice.surveys import drive_of, middle_of, real_rates
from benchmarks.report import Row
from benchmarks.stored_parts import stored
from vision_slam import localize

FIRST_SEED, N_SEEDS = 11001, 300
_AT_ONCE = 50
_VELOCITIES, _HOURS = (0.5, 1.0, 2.0, 4.0), (8.0, 24.0)


def motions(folder: Path, *, n: int) -> list[dict[str, Any]]:
    """Return scores and standard deviations of the motion of n surveys with four stakes, stored in parts."""
    found: list[dict[str, Any]] = []
    for first in range(0, n, _AT_ONCE):
        part = range(first, min(first + _AT_ONCE, n))
        file = folder / f"motions-{part[0]}-{part[-1]}.json"
        found += stored(file, lambda numbers=part: [_motion(k) for k in numbers])
    return found


def _motion(k: int) -> dict[str, Any]:
    case = Case(_VELOCITIES[k % 4], _HOURS[k // 4 % 2], 4, FIRST_SEED + k)
    drive = drive_of(case)
    motion = localize(drive.recording, drive.mission.assumed, motion=drive.prior()).ice_motion
    assert motion is not None
    place = middle_of(drive.nodes)
    sigma = motion.rates_sigma(place)[0]
    scores = (motion.rates(place) - real_rates(drive, place))[0] / sigma
    return {
        "velocity": scores[:2].tolist(),
        "lowering": float(scores[2]),
        "sigma": sigma.tolist(),
        "hours": case.hours,
    }


def rows(found: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield the rows of many motions."""
    yield Row("motions of other sites, 4 stakes", float(len(found)), "1")
    yield from share_rows("other sites: velocity", [score for one in found for score in one["velocity"]])
    yield from share_rows("other sites: lowering", [one["lowering"] for one in found])
    for hours in sorted({one["hours"] for one in found}):
        sigma = np.mean([one["sigma"] for one in found if one["hours"] == hours], axis=0)
        yield Row.of(
            f"other sites, {hours:g} h: standard deviation of the velocity",
            float(sigma[:2].max()),
            "m/day",
            "<=",
            0.1,
        )
        yield Row.of(
            f"other sites, {hours:g} h: standard deviation of the lowering",
            float(sigma[2]),
            "m/day",
            "<=",
            0.1,
        )
