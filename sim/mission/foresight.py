"""Prediction of the map error of a mission before it is driven, errors of the rover's position included.

The mission is simulated on the prior: the places of landmarks, and how their errors are shared, follow from the
route and the sensors alone. The error of the map between them is that of `planners.prediction`, as for every plan.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any, NamedTuple, Self

import numpy as np
from scipy import sparse

import planners
from planners.guarantee.survey_lines import smallest_sufficient
from planners.planning import planned_on, require_cover
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.error_model import ErrorModel
from planners.prediction.kernel_posterior import KernelPosterior
from planners.routes.replanning import with_way_home
from planners.routes.rover import Crew
from planners.routes.traversability import drivable
from sim.config.mission import MissionConfig
from sim.mission.localization import localize_recording
from sim.simulate.simulation import simulate_statistical
from sim.world.moving_ice import in_ice_order
from sim.world.site import World
from survey import ConfigError, Dem, Grid, Route, SurfacePoints
from survey.core import FloatArray, Progress
from survey.data.path_error import PathError
from survey.reconstruction.joint.shared_errors import LandmarkErrors, height_levers, keyframes_of

# Patches of ground whose landmarks' shared errors are taken as a whole.
_MOST_SHARED = 600
_BEYOND_M = 60.0
_STEP_M = 5.0
_UNSTATED_SIGMA_M = 1.0
# Patterns whose number of swaths can be varied, with everything else fixed before the drive.
_SIZED = (planners.LawnmowerConfig, planners.WavyConfig)
# Where the search for a number of swaths begins, and how many it tries for each number of stakes, about.
_FIRST_TRIED, _TRIED_EACH = 4, 3


class PredictedSurvey(NamedTuple):
    """A mission before it is driven.

    ``swaths`` is the number of lines, ``stakes`` that of the stakes, ``rmse_m`` the expected error of the map,
    ``site_mean_m`` the standard deviation of the site's mean height, ``chance`` the probability of meeting the limit,
    ``length_m`` the distance to drive on the ground, ``pieces`` the number of swaths that the lines are cut into,
    ``tie_lines`` the number of lines that cross the swaths, ``order`` that of the swaths (``ice.swath_order``).
    """

    swaths: int
    stakes: int
    rmse_m: float
    site_mean_m: float
    chance: float
    length_m: float
    pieces: int
    tie_lines: int = 0
    order: str = "adjacent"

    def __str__(self) -> str:
        """Return one line with the numbers and the probability."""
        stakes = f" and {self.tie_lines} lines across" if self.tie_lines else ""
        stakes += f" with {self.stakes} stakes" if self.stakes else ""
        stakes += ", every second swath first" if self.order == "alternate" else ""
        lines = (
            f"{self.swaths} swaths"
            if self.pieces == self.swaths
            else f"{self.swaths} lines in {self.pieces} pieces"
        )
        return (
            f"{lines}{stakes}: {self.rmse_m:.2f} m (level {self.site_mean_m:.2f} m), {100 * self.chance:.0f} %, "
            f"{self.length_m:.0f} m to drive"
        )


def predict_survey(
    mission: MissionConfig, world: World, *, limit_m: float, model: ErrorModel | None = None
) -> PredictedSurvey:
    r"""Predict the error of the map of a mission, with all that its landmarks share.

    The mission is driven over the prior. The error between its landmarks is that of `ErrorModel`, as in every plan. What
    the path adds follows from its posterior: with the covariance W Λ⁻¹ Wᵀ of the errors that landmarks share, the covariance of
    the map is larger by a part whose mean over the map is its level.

    `limit_m`: largest RMSE [m]. `model`: predictor of the error for this prior, as `error_model_of` returns it.
    """
    if mission.fidelity == "ideal":
        raise ConfigError(
            "the ideal fidelity has no errors of position to predict; set fidelity = 'statistical'."
        )
    model = model or error_model_of(mission, world)
    points, path, route = _driven(mission, world)
    predictor, fine = model.predictor, _Patches.of(points, model.errors.sample_step_m)
    relief = predictor.distribution(fine.xy, fine.errors_of(model.posterior), fine.own_m2)
    few = fine
    while len(few.xy) > _MOST_SHARED:
        few = _Patches.of(points, 1.25 * few.side_m)
    (one,) = few.errors_of(KernelPosterior.of([model.posterior.likeliest])).kernels
    part = predictor.shared_part(few.xy, one, few.own_m2, few.shared_m2(points, path, mission))
    found = relief.with_part(part)
    tie_lines = mission.planner.tie_lines if isinstance(mission.planner, _SIZED) else 0
    return PredictedSurvey(
        route.n_lines - tie_lines,
        mission.aids.stakes,
        found.rmse_m,
        found.shared_m,
        found.probability(limit_m),
        route.ground_length_m,
        len(route.swaths) - tie_lines,
        tie_lines,
        "adjacent" if mission.ice is None else mission.ice.swath_order,
    )


def error_model_of(mission: MissionConfig, world: World) -> ErrorModel:
    """Return the predictor of errors of maps of a mission's site, with its prior."""
    sigma_m = mission.reconstruction.joint.satellite.sigma_m or _UNSTATED_SIGMA_M
    assumed = MapAssumptions(prior_sigma_m=sigma_m, micro_relief_m=mission.reconstruction.gp.nugget_m)
    model = ErrorModel.from_prior(world.area, world.prior, assumed)
    if mission.reconstruction.use_prior:
        return model
    return replace(model, predictor=replace(model.predictor, cells=None))


@dataclass(frozen=True)
class _Patches:
    """Means of the landmarks of each patch of ground: places (S, 2) [m], variances of their own errors (S,) [m²].

    `side_m`: side of a patch [m]. `localization_m`: error of the path's place, east and north each [m]. `shares` (S, N):
    sparse weights of the landmarks.
    """

    xy: FloatArray
    own_m2: FloatArray
    side_m: float
    localization_m: float
    shares: Any

    @classmethod
    def of(cls, points: SurfacePoints, side_m: float) -> Self:
        """Average landmarks over square patches, the more precise ones with more weight."""
        own, total = points.own_covariance, points.covariance
        assert own is not None
        assert total is not None
        _, patch = np.unique(np.floor(points.xy / side_m), axis=0, return_inverse=True)
        weight = 1.0 / own[:, 2, 2]
        sums = np.bincount(patch.ravel(), weight)
        shares = sparse.csr_array((weight / sums[patch.ravel()], (patch.ravel(), np.arange(len(points)))))
        place_m2 = np.maximum((total - own)[:, [0, 1], [0, 1]], 0.0)
        xy: FloatArray = np.asarray(shares @ points.xy)
        return cls(xy, 1.0 / sums, side_m, float(np.sqrt(place_m2.mean())), shares)

    def errors_of(self, posterior: KernelPosterior) -> KernelPosterior:
        """Return the covariances of the terrain for samples that are these means."""
        return posterior.of_means(self.localization_m, self.shares.shape[1] / self.shares.shape[0])

    def shared_m2(self, points: SurfacePoints, path: PathError, mission: MissionConfig) -> FloatArray:
        """Return the covariance (S, S) of the errors of height that the means share by the path and by the landmarks [m²]."""
        levers = height_levers(points, np.zeros((len(points), 2)))
        beyond = LandmarkErrors.of(points, mission.reconstruction.joint)
        scaled = self.shares @ beyond.rows @ sparse.diags_array(beyond.sigma)
        of_path = path.covariance(sparse.csr_array(self.shares @ path.rows(keyframes_of(points), levers)))
        shared: FloatArray = of_path + (scaled @ scaled.T).toarray()
        return shared


def surveys_within(
    mission: MissionConfig,
    world: World,
    *,
    limit_m: float,
    probability: float = 0.9,
    least_swaths: int = 2,
    most_swaths: int = 8,
    model: ErrorModel | None = None,
    progress: Progress | None = None,
    tried: list[PredictedSurvey] | None = None,
) -> Iterator[PredictedSurvey]:
    """Yield, for 0, 2 and 4 stakes, the fewest swaths that meet the limit with a probability, if any do.

    On moving ice the limit is that of the map at its epoch, and each is tried with two lines that cross the swaths, too, and
    with every second swath driven first: ground that is seen at different times shows the motion.

    `limit_m`: largest RMSE [m]. `model`: as of `predict_survey`. `tried`: list that all predictions are added to.
    """
    if type(mission.planner) not in _SIZED:
        names = " and ".join(kind.model_fields["pattern"].default for kind in _SIZED)
        raise ConfigError(
            f"numbers of swaths and stakes are compared for the patterns {names}, not {mission.planner.pattern}; take one of them."
        )
    require_cover(world.area, world.prior)
    counts = range(least_swaths, most_swaths + 1)
    first = min(max(least_swaths, _FIRST_TRIED), most_swaths)
    choices = list(product((0, 2, 4), _ways(mission, world)))
    found_model, made = model or error_model_of(mission, world), [] if tried is None else tried

    def predict(one: MissionConfig) -> PredictedSurvey:
        if progress is not None:
            progress("predicting surveys", len(made), max(_TRIED_EACH * len(choices), len(made) + 1))
        made.append(predict_survey(one, world, limit_m=limit_m, model=found_model))
        return made[-1]

    for stakes, way in choices:
        aids = mission.aids.model_copy(update={"stakes": stakes})
        staked = way.model_copy(update={"aids": aids})
        found = _fewest_swaths(staked, predict, probability, counts=counts, first=first)
        if found is not None:
            first, survey = found
            yield survey


def _ways(mission: MissionConfig, world: World) -> list[MissionConfig]:
    """Return the ways to drive that are compared: on moving ice without and with lines across, and every second swath first."""
    if mission.ice is None:
        return [mission]
    ways = []
    for tie_lines, order in ((0, "adjacent"), (2, "adjacent"), (0, "alternate")):
        planner = mission.planner.model_copy(update={"tie_lines": tie_lines})
        ice = mission.ice.model_copy(update={"swath_order": order})
        ways.append(mission.model_copy(update={"planner": planner, "ice": ice}))
    try:
        _planned(ways[-1], world)
    except ConfigError:
        return ways[:-1]
    return ways


def _fewest_swaths(
    mission: MissionConfig,
    predict: Callable[[MissionConfig], PredictedSurvey],
    probability: float,
    *,
    counts: range,
    first: int,
) -> tuple[int, PredictedSurvey] | None:
    """Return the smallest number of swaths that is predicted to be enough, sought from `first` on."""

    @cache
    def predicted(swaths: int) -> PredictedSurvey:
        sized = mission.planner.model_copy(update={"swaths": swaths, "spacing_m": None})
        return predict(mission.model_copy(update={"planner": sized}))

    nth = smallest_sufficient(
        lambda n: predicted(counts[n - 1]).chance >= probability,
        first=counts.index(first) + 1,
        most=len(counts),
    )
    return None if nth is None else (counts[nth - 1], predicted(counts[nth - 1]))


def cheapest(surveys: Iterable[PredictedSurvey]) -> PredictedSurvey | None:
    """Return the survey with the least to drive, and of those the one with the fewest stakes."""
    return min(surveys, key=lambda one: (round(one.length_m), one.stakes), default=None)


def _driven(mission: MissionConfig, world: World) -> tuple[SurfacePoints, PathError, Route]:
    """Drive the mission over the prior and localize; return its landmarks, the error of its path and the route."""
    ground = _read_beyond(world.prior, world.area.bounds)
    route = _planned(mission, world)
    recording, _ = simulate_statistical(ground, route, mission)
    found = localize_recording(recording, mission)
    if found.trajectory.error is None:
        raise ConfigError("the mission has no odometry, so that shared errors are not known; add it.")
    return found.points, found.trajectory.error, route


def _planned(mission: MissionConfig, world: World) -> Route:
    """Return the route of a mission on ground that can be driven everywhere."""
    route = planned_on(drivable(world.area), world.area, mission.planner, crew=Crew(dem=world.prior))
    route = in_ice_order(route, mission, world)
    return with_way_home(route, world.area) if mission.aids.way_home else route


def _read_beyond(prior: Dem, bounds: tuple[float, float, float, float]) -> Dem:
    """Read the prior on 5 m, and what a camera sees beyond it as its nearest cell."""
    xmin, ymin, xmax, ymax = bounds
    grid = Grid.over(
        (xmin - _BEYOND_M, ymin - _BEYOND_M, xmax + _BEYOND_M, ymax + _BEYOND_M), _STEP_M, prior.crs
    )
    low, high = np.array(prior.bounds[:2]), np.array(prior.bounds[2:])
    heights = prior.at(np.clip(grid.xy, low + 1e-6, high - 1e-6))
    level = float(np.nanmean(prior.elevation))
    return Dem.on(
        grid, np.where(np.isfinite(heights), heights, level).reshape(grid.shape), prior.vertical_datum
    )
