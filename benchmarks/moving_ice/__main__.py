"""Surveys on moving ice: maps at an epoch, velocities and lowering, feature tracking, and real stakes.

Run with ``python -m benchmarks.moving_ice``. Sites of 100 × 100 m are surveyed by four swaths in 8 and in 24 hours, on ice
that moves by 0.5 to 4 m a day and melts by 6 cm a day, with a base station on rock; with four stakes that are surveyed four
times, and without. Every map is judged against the terrain of its epoch, the middle of the drive, and compared with that of
the same survey with the same errors on still ice, and with the static estimate of the same recording. Maps have no prior
and the kernel of the terrain, so that they differ by the motion alone; other benchmarks judge fitted kernels.

Seeds 9301 to 9308 are judged, three of them for other models, and 9401 to 9460 for motions; the methods were developed on 9001, 9002, 9101 to 9104 and 9201
to 9240, the feature tracking on another raster. Parts are stored as they finish (``FIRNLINE_MOVING_ICE`` names the folder); a run that was broken
off continues. Real ground is read from ``FIRNLINE_DATA``, beside the checkout by default. Pairs of surveys have a command of
their own, ``python -m benchmarks.moving_ice.mass_change``.
"""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

from benchmarks.moving_ice import motions, stake_series, tracked
from benchmarks.moving_ice.figures import rows
from benchmarks.moving_ice.parts import SURVEYS, folder_of
from benchmarks.moving_ice.surveys import Case, outcomes_of
from benchmarks.report import Row, main
from benchmarks.stored_parts import ROOT, stored

DATA = Path(os.environ.get("FIRNLINE_DATA", ROOT.parent / "shared" / "data"))
SEEDS, VELOCITIES = tuple(range(9301, 9309)), (0.5, 1.0, 2.0, 4.0)
_FEWER = SEEDS[:3]


def cases(*, quick: bool) -> list[Case]:
    """Return the surveys."""
    if quick:
        return [Case(0.0, 8.0, 4, SEEDS[0]), Case(4.0, 8.0, 4, SEEDS[0])]
    found = [
        Case(velocity, hours, 4, seed)
        for seed in SEEDS
        for hours in (8.0, 24.0)
        for velocity in (0.0, *VELOCITIES)
    ]
    found += [Case(velocity, 24.0, 0, seed) for seed in _FEWER for velocity in (0.0, 1.0, 4.0)]
    found += [Case(2.0, 24.0, 4, seed, flow="valley", has_planes=p) for seed in _FEWER for p in (False, True)]
    return found + [Case(2.0, 24.0, 4, seed, diurnal_share=1.0) for seed in _FEWER]


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    matching = folder_of("survey/scoring/motion", "benchmarks/moving_ice/tracked.py")
    yield from tracked.rows(stored(matching / "tracked.json", lambda: tracked.tracked(DATA)))
    predicting = folder_of(
        "survey/reconstruction/motion/stake_series.py", "benchmarks/moving_ice/stake_series.py"
    )
    yield from stake_series.rows(stored(predicting / "stakes.json", lambda: stake_series.predicted(DATA)))
    logging.disable(logging.WARNING)
    folder = folder_of(*SURVEYS)
    found = {
        case: stored(folder / f"{case.name}.json", lambda c=case: outcomes_of(c))
        for case in cases(quick=quick)
    }
    yield from rows(found, VELOCITIES)
    n_motions = 4 if quick else motions.N_SEEDS
    yield from motions.rows(stored(folder / f"motions-{n_motions}.json", lambda: motions.motions(n_motions)))


if __name__ == "__main__":
    main("Moving ice", measure, ("numpy", "scipy", "finufft", "numba"))
