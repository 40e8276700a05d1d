"""Surveys of ice and terrain that the estimate does not have in its model.

Run with ``python -m benchmarks.moving_ice.other_models``: a valley glacier that is slower towards its margins, melt with a daily
cycle, and terrain of another kind (fractional Brownian), on which the map finds its kernel as a user's does; 2 m a day, 24 hours,
four stakes, the seeds 10001 to 10004.
"""

import logging
from collections.abc import Iterator

from benchmarks.moving_ice.cases import TERRAIN, Case
from benchmarks.moving_ice.figures import Outcomes, mean, rms
from benchmarks.moving_ice.parts import SURVEYS, folder_of
from benchmarks.moving_ice.surveys import outcomes_of
from benchmarks.report import Row, main
from benchmarks.stored_parts import stored

SEEDS = tuple(range(10001, 10005))


def cases(*, quick: bool) -> list[Case]:
    """Return the surveys."""
    seeds = SEEDS[:1] if quick else SEEDS
    found = [Case(2.0, 24.0, 4, seed, flow="valley", has_planes=p) for seed in seeds for p in (False, True)]
    found += [Case(2.0, 24.0, 4, seed, diurnal_share=1.0) for seed in seeds]
    return found + [Case(2.0, 24.0, 4, seed, ground="fractional_brownian") for seed in seeds]


def rows(found: Outcomes) -> Iterator[Row]:
    """Yield coverage and error of the maps, and the error that they claim."""
    kinds = {
        "valley glacier, one velocity estimated": lambda c: c.flow == "valley" and not c.has_planes,
        "valley glacier, velocity with planes estimated": lambda c: c.flow == "valley" and c.has_planes,
        "melt with a daily cycle": lambda c: c.flow == "uniform" and c.diurnal_share > 0.0,
        "terrain of another kind, kernel by evidence": lambda c: c.ground != TERRAIN.family,
    }
    for name, is_kind in kinds.items():
        mine = [case for case in found if is_kind(case)]
        yield Row(f"{name}: coverage of 95 %", mean(found, mine, "moving", "coverage"), "1")
        yield Row(
            f"{name}: coverage of 95 % of the static estimate", mean(found, mine, "static", "coverage"), "1"
        )
        yield Row(f"{name}: RMSE", rms(found, mine, "moving"), "m")
        yield Row(f"{name}: RMSE claimed, mean", mean(found, mine, "moving", "claimed_m"), "m")


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    logging.disable(logging.WARNING)
    folder = folder_of(*SURVEYS)
    yield from rows(
        {
            case: stored(folder / f"{case.name}.json", lambda c=case: outcomes_of(c))
            for case in cases(quick=quick)
        }
    )


if __name__ == "__main__":
    main("Other models of moving ice", measure, ("numpy", "scipy", "finufft", "numba"))
