"""Random cases of two requirements, one harder than the other: the harder must not take fewer swaths."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.promise_on_real_ground.windows import SEED
from planners.guarantee.guarantee import SwathSearch
from planners.guarantee.requirement import MapRequirement
from planners.prediction.error_model import model_in_grid
from survey import Grid, SurveyArea
from survey.core.streams import stream
from survey.terrain import random_dem, satellite_copy

N_SITES, N_EACH = 40, 25
_CRS = "EPSG:32608"
_FAMILIES = ("squared-exponential", "matern-5/2", "matern-3/2")


@dataclass(frozen=True)
class Violations:
    """Cases of one site, and those in which the harder requirement took fewer swaths."""

    n_cases: int
    n_violated: int


def violations(index: int) -> Violations:
    """Compare pairs of requirements on one random site, each harder in noise, prior, limit and probability at once."""
    violated = [harder < easier for easier, harder in _pairs(index)]
    return Violations(len(violated), int(np.sum(violated)))


def _pairs(index: int) -> Iterator[tuple[float, float]]:
    """Yield the swaths of an easier and of a harder requirement; infinite where none are enough."""
    rng = stream(SEED, "monotony", index)
    side_m = float(rng.choice([120.0, 160.0, 200.0]))
    area = SurveyArea.rectangle((0.0, 0.0, side_m, side_m), _CRS)
    grid = Grid((0.0, 0.0, side_m, side_m), 5.0, _CRS)
    length_m = float(rng.uniform(30.0, 120.0))
    relief_m = float(rng.uniform(2.0, 15.0))
    terrain = random_dem(str(rng.choice(_FAMILIES)), grid, rng, relief_m, length_scale_m=length_m)
    prior = satellite_copy(terrain, rng=rng, cell_m=20.0, sigma_m=float(rng.uniform(0.0, 1.0)))
    noises_m = np.sort(rng.uniform(0.0, 0.4, 3))
    searches = [
        SwathSearch.of(area, prior, MapRequirement(1.0, noise_m=float(noise_m), max_swaths=14))
        for noise_m in noises_m
    ]
    for _ in range(N_EACH):
        yield _pair(rng, area, prior_searches=searches)


def _pair(
    rng: np.random.Generator, area: SurveyArea, prior_searches: list[SwathSearch]
) -> tuple[float, float]:
    """Return the swaths of an easier and of a harder requirement drawn at random."""
    noise = np.sort(rng.integers(0, len(prior_searches), 2))
    limit_m = np.sort(rng.uniform(0.1, 1.0, 2))[::-1]
    probability = np.sort(rng.uniform(0.55, 0.99, 2))
    sigma_m = np.sort(rng.uniform(0.1, 10.0, 2))
    found = []
    for k in range(2):
        search = prior_searches[noise[k]]
        requirement = replace(
            search.requirement,
            limit_m=float(limit_m[k]),
            probability=float(probability[k]),
            prior_sigma_m=float(sigma_m[k]),
        )
        model = model_in_grid(area, search.prior, requirement)
        asked = SwathSearch(requirement, search.prior, search.site, model, search.heading_deg, search.counts)
        counts = [asked.fewest(shape) for shape in asked.patterns()]
        found.append(float(min((n for n in counts if n is not None), default=np.inf)))
    return found[0], found[1]
