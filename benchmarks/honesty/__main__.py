"""Honesty of maps: coverage and error of statistical surveys over kinds of terrain and kinds of priors.

Run with ``python -m benchmarks.honesty``; ``FIRNLINE_HONESTY_SEEDS=5`` takes fewer seeds than twenty. A survey takes some
15 s of CPU time; outcomes are stored, and a run that was broken off continues. Seeds 7101 and later were used for nothing
else; settings were chosen on seeds 101, 102, 201 and 202, and seeds 7001 and 7002 were looked at.

A site is 480 × 480 m with cells of 60 m; four lawnmower swaths, a landmark every 4 m, a receiver whose errors last
60 to 900 s in turn while the estimator starts from the default of 120 s. The estimator assumes the class ``unknown`` of
priors; for one kind the class ``unbiased`` is stated, which is true, for another a white error that is 3 times too large
or too small. Maps are solved for once with the prior, with 6 MB of waves and a node of the path every 30 m; maps without a
prior, with a truthful one and with one that has all errors are tested by leaving swaths out, as commands do. In every
third survey an oracle is given the error model from which each prior was drawn and the receiver's memory; in every sixth
one map is made with sizes of the sensors' errors that are wrong by factors of up to two. Where ``FIRNLINE_EARLIER`` names a
checkout of commit e7dc4dd with an environment of its own, its maps of moraine, ridges and SRTM windows with a truthful prior
are compared. Ratios are those of mean errors over the same surveys.
"""

from collections.abc import Iterator

from benchmarks.honesty.figures import rows
from benchmarks.honesty.parts import earlier_outcomes, judged_seeds, outcomes
from benchmarks.report import Row, main


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    seeds = judged_seeds(quick=quick)
    yield from rows(outcomes(seeds), earlier_outcomes(seeds))


if __name__ == "__main__":
    main("Honesty", measure, ("numpy", "scipy", "finufft"))
