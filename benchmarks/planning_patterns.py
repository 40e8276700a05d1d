"""Survey patterns: distance at equal map error, and what planning them costs.

``python -m benchmarks.planning_patterns [--quick] [--json FILE]``

Every survey is mapped by a Gaussian process refitted to its own samples. Planning knows
the covariance that pilot surveys of other terrain of the same kind agree upon, or a coarse
prior; the terrain judged on here was used for no setting. The piecewise-continuous
pattern stands beside two controls: a blind wander by the same steps, and itself steered
by the slopes of another terrain. The best pattern is the shortest one that is predicted
to err no more than the plain lawnmower. ``at Class 3``: the ratio of distances at
a mean error of 0.4572 m, or in the middle of the errors that both patterns reach.
"""

from collections.abc import Callable, Iterator, Sequence

import planners
from benchmarks.equal_error import AREA, FAMILIES, Curve, Family, RouteMaker, curve, pilot_kernel, ratios
from benchmarks.report import Row, cpu_seconds, main
from planners.patterns.best import INSET_SHARE
from survey import Dem, Route
from survey.core.streams import stream
from survey.reconstruction.gp.kernels import Kernel
from survey.terrain import satellite_copy

PILOT_SEED, JUDGED_SEED, NOISE_SEED = 900, 20_261, 77


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of all families and noises."""
    n_dems = 8 if quick else 30
    families = (FAMILIES[0], FAMILIES[3]) if quick else FAMILIES
    for family in families:
        dems = family.dems(JUDGED_SEED, n_dems)
        for noise_m in (0.0, 0.3):
            yield from _compared(family, dems, noise_m, quick)
    yield from _costs()


def _compared(family: Family, dems: Sequence[Dem], noise_m: float, quick: bool) -> Iterator[Row]:
    kernel = pilot_kernel(family, noise_m, PILOT_SEED)
    sizes = family.swaths[::2] if quick else family.swaths

    def survey(make: RouteMaker) -> Curve:
        return curve(make, sizes, dems, noise_m, NOISE_SEED)

    plain = survey(_planned(lambda n: planners.LawnmowerConfig(swaths=n), None, noise_m))
    inset = survey(
        _planned(lambda n: planners.LawnmowerConfig(swaths=n, inset_share=INSET_SHARE), None, noise_m)
    )
    wavy = survey(_planned(lambda n: planners.WavyConfig(swaths=n), kernel, noise_m))
    where = f"{family.name}, noise {noise_m:g} m"
    yield from _bars(where, family.is_smooth, noise_m, ratios(wavy, plain), ratios(wavy, inset))
    yield Row(f"{where}: inset / plain at Class 3", ratios(inset, plain)[0], "x")
    best = survey(_shortest(kernel, noise_m))
    yield Row(f"{where}: best by predicted error / plain at Class 3", ratios(best, plain)[0], "x")
    yield Row(f"{where}: best / plain, largest at any error", ratios(best, plain)[1], "x")
    yield Row(f"{where}: best / inset at Class 3", ratios(best, inset)[0], "x")
    if quick:
        return
    by_prior = survey(_planned_by_prior(noise_m))
    yield Row(f"{where}: wavy planned by each terrain's 75 m prior / plain", ratios(by_prior, plain)[0], "x")
    steered = survey(_steered(planners.PiecewiseContinuousConfig))
    elsewhere = survey(_steered(planners.PiecewiseContinuousConfig, n_shifted=1))
    wander = survey(_steered(planners.RandomWanderConfig))
    yield Row(f"{where}: piecewise-continuous / plain at Class 3", ratios(steered, plain)[0], "x")
    yield Row(f"{where}: random wander / plain at Class 3", ratios(wander, plain)[0], "x")
    yield Row(f"{where}: piecewise-continuous / random wander", ratios(steered, wander)[0], "x")
    yield Row(
        f"{where}: piecewise-continuous / same, steered by other terrain", ratios(steered, elsewhere)[0], "x"
    )


def _bars(
    where: str, is_smooth: bool, noise_m: float, to_plain: tuple[float, float], to_inset: tuple[float, float]
) -> Iterator[Row]:
    if not is_smooth:
        yield Row.of(f"{where}: wavy / plain at Class 3", to_plain[0], "x", "<=", 0.90)
        yield Row.of(f"{where}: wavy / plain, largest at any error", to_plain[1], "x", "<=", 1.0)
        yield Row(f"{where}: wavy / inset at Class 3", to_inset[0], "x")
    elif noise_m == 0.0:
        yield Row.of(f"{where}: wavy / plain at Class 3", to_plain[0], "x", "<=", 0.55)
        yield Row.of(f"{where}: wavy / inset at Class 3", to_inset[0], "x", "<=", 0.65)
    else:
        yield Row.of(f"{where}: wavy / plain at Class 3", to_plain[0], "x", "<=", 0.80)
        yield Row(f"{where}: wavy / inset at Class 3", to_inset[0], "x")


def _planned(
    config: Callable[[int], planners.PlannerConfig], kernel: Kernel | None, noise_m: float
) -> RouteMaker:
    def make(n: int, _: Sequence[Dem]) -> list[Route]:
        return [planners.plan(AREA, None, config(n), kernel=kernel, noise_m=noise_m, sample_step_m=15.0)]

    return make


def _shortest(kernel: Kernel, noise_m: float) -> RouteMaker:
    """Plan the shortest choice that is predicted to err no more than the plain lawnmower of so many swaths."""

    def make(n: int, _: Sequence[Dem]) -> list[Route]:
        def planned(config: planners.PlannerConfig) -> Route:
            return planners.plan(AREA, None, config, kernel=kernel, noise_m=noise_m, sample_step_m=15.0)

        plain = planned(planners.LawnmowerConfig(swaths=n))
        return [planned(planners.BestConfig(rmse_m=plain.prediction["rmse_m"]))]

    return make


def _planned_by_prior(noise_m: float) -> RouteMaker:
    """Wavy swaths as a user plans them: the covariance is fitted to a coarse copy of the terrain, 1 m in error."""

    def make(n: int, dems: Sequence[Dem]) -> list[Route]:
        config = planners.WavyConfig(swaths=n)
        rngs = [stream(JUDGED_SEED, "prior", i) for i in range(len(dems))]
        priors = [satellite_copy(dem, cell_m=75.0, rng=rng) for dem, rng in zip(dems, rngs, strict=True)]
        return [planners.plan(AREA, prior, config, noise_m=noise_m, sample_step_m=15.0) for prior in priors]

    return make


def _steered(
    kind: type[planners.PiecewiseContinuousConfig] | type[planners.RandomWanderConfig], n_shifted: int = 0
) -> RouteMaker:
    """Routes steered by the slopes of each terrain, or as a control by those of the `n_shifted`-th next one."""

    def make(n: int, dems: Sequence[Dem]) -> list[Route]:
        config = kind(swaths=n)
        steering = planners.steering_of(config)
        if steering is None:
            raise TypeError(f"{kind.__name__} is not steered")
        rngs = [stream(JUDGED_SEED, "steering", n, i) for i in range(len(dems))]
        reference = planners.plan(AREA, None, config)
        sensed = [*dems[n_shifted:], *dems[:n_shifted]]
        return planners.rollout(AREA, reference, steering, planners.attitude_sensor(sensed), rngs)

    return make


def _costs() -> Iterator[Row]:
    """Yield CPU seconds of planning, after a first run that compiles nothing but fills caches."""
    dems = FAMILIES[0].dems(PILOT_SEED, 100)
    kernel = pilot_kernel(FAMILIES[0], 0.0, PILOT_SEED)
    makers = [_steered(kind) for kind in (planners.PiecewiseContinuousConfig, planners.RandomWanderConfig)]
    makers[0](1, dems)
    _, seconds = cpu_seconds(lambda: [make(n, dems) for make in makers for n in range(1, 11)])
    yield Row.of("steered patterns, 100 terrains x 10 swath counts x 2", seconds, "s", "<=", 10.0)
    _, seconds = cpu_seconds(lambda: planners.plan(AREA, None, planners.BestConfig(swaths=5), kernel=kernel))
    yield Row("choice of the best pattern, 5 swaths", seconds, "s")
    route, _ = cpu_seconds(lambda: planners.plan(AREA, None, planners.LawnmowerConfig(swaths=10)))
    _, seconds = cpu_seconds(lambda: planners.predict_error(route, AREA, kernel, noise_m=0.1))
    yield Row("predicted error of 10 swaths, 900 nodes", seconds, "s")


if __name__ == "__main__":
    main("Survey patterns at equal error", measure, ("numpy", "scipy", "shapely"))
