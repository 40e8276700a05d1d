"""Honesty of maps of missions in images: coverage and error on sites that nothing was chosen on.

Run with ``python -m benchmarks.honest_missions``. Five sites of 120 × 120 m are surveyed by three lawnmower swaths and by
two piecewise-continuous ones, and the last of them by a single swath of either pattern: ``examples/mendenhall_like.toml``
at a fifth of its size, with swaths as far apart as there for the length of its landforms; the prior has 8 × 8 cells. Each
mission is driven and its images are processed once; recordings and outcomes are stored (``FIRNLINE_HONEST_MISSIONS`` names
the folder), and a run that was broken off continues. Seeds 421 to 425 were used for nothing
else (``FIRNLINE_HONEST_MISSIONS_SEEDS`` names others); methods were developed on sites of 60 × 60 m with the seeds 181 to
185, and on those of 120 × 120 m with the seeds 391 to 395, 401 to 405 and 411 to 415, which were judged before.

Maps are made as a mission makes them: kernel chosen, tested by swaths left out, with a prior that is unbiased and stated
so, with a prior that has the errors of a product and is stated as such, and without a prior; with four stakes and
without. The first one is compared with the map of the same recording by the code of commit e7dc4dd, where
``FIRNLINE_EARLIER`` names a checkout of it with an environment of its own.
"""

from collections.abc import Iterator

from benchmarks.honest_missions.figures import rows
from benchmarks.honest_missions.parts import earlier, outcomes
from benchmarks.report import Row, main


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    found = outcomes(quick=quick)
    yield from rows(found, earlier(found))


if __name__ == "__main__":
    main("Honest missions", measure, ("numpy", "scipy", "finufft", "opencv-python-headless", "numba"))
