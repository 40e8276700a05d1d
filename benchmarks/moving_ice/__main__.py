"""Surveys on moving ice: maps at an epoch, velocities and lowering, feature tracking, real stakes and rasters.

Run with ``python -m benchmarks.moving_ice``. Sites of 100 × 100 m are surveyed by four swaths in 8 or in 24 hours, on ice
that moves by 0.5 to 4 m a day and melts by 6 ± 2 cm a day, with a base station on rock; with four stakes that are surveyed
four times, and without. Every map is judged against the terrain of its epoch, the middle of the drive, and compared with that
of the same survey with the same errors on still ice, and with the static estimate of the same recording. Maps have no prior
and the kernel of the terrain, so that they differ by the motion alone.

All errors are drawn as the estimate assumes them (`benchmarks.moving_ice.cases`), so that a calibrated estimate covers 95 %
in the mean of many sites. The errors of one map are correlated, and its coverage is spread widely about 95 %: beside mean
coverages stand their quantiles in draws from the claimed covariances of the maps, beside shares those of a binomial
distribution. The bar of 93 to 97 % stands where a calibrated estimate keeps to it nine times in ten.

Seeds 10001 to 10032 are judged, and 11001 to 11300 for motions; the methods were developed on 9001 to 9040, 9101 to 9104 and
9201 to 9240, the feature tracking on another raster. Parts are stored as they finish (``FIRNLINE_MOVING_ICE`` names the
folder); a run that was broken off continues. Real ground is read from ``FIRNLINE_DATA``, beside the checkout by default.
Pairs of surveys have a command of their own, ``python -m benchmarks.moving_ice.mass_change``, and so have ice and terrain that
the estimate does not have in its model, ``python -m benchmarks.moving_ice.other_models``.
"""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

from benchmarks.moving_ice import motions, raster_prior, stake_series, tracked
from benchmarks.moving_ice.cases import Case
from benchmarks.moving_ice.figures import rows
from benchmarks.moving_ice.parts import SURVEYS, folder_of
from benchmarks.moving_ice.surveys import outcomes_of
from benchmarks.report import Row, main
from benchmarks.stored_parts import ROOT, stored

DATA = Path(os.environ.get("FIRNLINE_DATA", ROOT.parent / "shared" / "data"))
SEEDS, VELOCITIES = tuple(range(10001, 10033)), (0.5, 1.0, 2.0, 4.0)
_FEWER = SEEDS[:4]


def cases(*, quick: bool) -> list[Case]:
    """Return the surveys: of every site one on moving ice and the same on still ice, and some without stakes."""
    if quick:
        return [Case(0.0, 8.0, 4, SEEDS[0]), Case(4.0, 8.0, 4, SEEDS[0])]
    found = []
    for k, seed in enumerate(SEEDS):
        velocity, hours = VELOCITIES[k % 4], (8.0, 24.0)[k // 4 % 2]
        found += [Case(v, hours, 4, seed) for v in (0.0, velocity)]
    return found + [Case(velocity, 24.0, 0, seed) for seed in _FEWER for velocity in (0.0, 1.0, 4.0)]


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    matching = folder_of(
        "survey/scoring/differencing/tracking.py",
        "survey/scoring/differencing/displacements.py",
        "benchmarks/moving_ice/tracked.py",
    )
    yield from tracked.rows(stored(matching / "tracked.json", lambda: tracked.tracked(DATA)))
    predicting = folder_of("survey/reconstruction/motion/stakes.py", "benchmarks/moving_ice/stake_series.py")
    yield from stake_series.rows(stored(predicting / "stakes.json", lambda: stake_series.predicted(DATA)))
    folder = folder_of("survey/reconstruction/motion/priors.py", "benchmarks/moving_ice/raster_prior.py")
    yield from raster_prior.rows(stored(folder / "rasters.json", lambda: raster_prior.predicted(DATA)))
    logging.disable(logging.WARNING)
    folder = folder_of(*SURVEYS)
    found = {
        case: stored(folder / f"{case.name}.json", lambda c=case: outcomes_of(c))
        for case in cases(quick=quick)
    }
    yield from rows(found, VELOCITIES)
    n_motions = 4 if quick else motions.N_SEEDS
    yield from motions.rows(motions.motions(folder, n=n_motions))


if __name__ == "__main__":
    main("Moving ice", measure, ("numpy", "scipy", "finufft", "numba"))
