"""Prediction of the map error of one mission before it is driven, errors of the rover's position included.

The mission is simulated on the prior: the places of landmarks, and how their errors are shared, follow from the
route and the sensors alone. The error of the map between them is that of `planners.prediction`, as for every plan.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from scipy import sparse

from planners.planning import planned_on
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.error_distribution import ErrorDistribution
from planners.prediction.error_model import ErrorModel
from planners.routes.replanning import with_way_home
from planners.routes.rover import Crew
from planners.routes.traversability import drivable
from sim.config.mission import MissionConfig
from sim.mission.localization import localize_recording
from sim.simulate.simulation import simulate_statistical
from sim.world.moving_ice import in_ice_order
from sim.world.site import World
from survey.core import ConfigError, FloatArray
from survey.data import Dem, Grid, PathError, Route, SurfacePoints
from survey.reconstruction.joint.shared_errors import LandmarkErrors, height_levers, keyframes_of

# Patches of ground whose landmarks' shared errors are taken as a whole.
_MOST_SHARED = 600
_BEYOND_M = 60.0
_STEP_M = 5.0
_UNSTATED_SIGMA_M = 1.0


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
    """Predict the error of the map of a mission, with all that its landmarks share.

    `limit_m`: largest RMSE [m]. `model`: predictor of the error for this prior, as `error_model_of` returns it.
    """
    found, route = predicted_drive(mission, world, model or error_model_of(mission, world))
    tie_lines = getattr(mission.planner, "tie_lines", 0)
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


def predicted_drive(
    mission: MissionConfig, world: World, model: ErrorModel
) -> tuple[ErrorDistribution, Route]:
    r"""Return the distribution of the error of a mission's map, and the route.

    The mission is driven over the prior. The error between its landmarks is that of `ErrorModel`, as in every plan. What
    the path adds follows from its posterior: with the covariance W Λ⁻¹ Wᵀ of the errors that landmarks share, the covariance of
    the map is larger by a part whose mean over the map is its level.
    """
    if mission.fidelity == "ideal":
        raise ConfigError(
            "the ideal fidelity has no errors of position to predict; set fidelity = 'statistical'."
        )
    points, path, route = _driven(mission, world)
    predictor, fine = model.predictor, _Patches.of(points, model.errors.sample_step_m)
    posterior = model.posterior.of_means(fine.localization_m, fine.n_in_one)
    relief = predictor.distribution(fine.xy, posterior, fine.own_m2)
    few = fine
    while len(few.xy) > _MOST_SHARED:
        few = _Patches.of(points, 1.25 * few.side_m)
    one = model.posterior.of_means(few.localization_m, few.n_in_one).likeliest
    part = predictor.shared_part(few.xy, one, few.own_m2, few.shared_m2(points, path, mission))
    return relief.with_part(part), route


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

    @property
    def n_in_one(self) -> float:
        """Mean number of landmarks of a patch."""
        return float(self.shares.shape[1] / self.shares.shape[0])

    def shared_m2(self, points: SurfacePoints, path: PathError, mission: MissionConfig) -> FloatArray:
        """Return the covariance (S, S) of the errors of height that the means share by the path and by the landmarks [m²]."""
        levers = height_levers(points, np.zeros((len(points), 2)))
        beyond = LandmarkErrors.of(points, mission.reconstruction.joint)
        scaled = self.shares @ beyond.rows @ sparse.diags_array(beyond.sigma)
        of_path = path.covariance(sparse.csr_array(self.shares @ path.rows(keyframes_of(points), levers)))
        shared: FloatArray = of_path + (scaled @ scaled.T).toarray()
        return shared


def _driven(mission: MissionConfig, world: World) -> tuple[SurfacePoints, PathError, Route]:
    """Drive the mission over the prior and localize; return its landmarks, the error of its path and the route."""
    ground = _read_beyond(world.prior, world.area.bounds)
    route = planned_mission(mission, world)
    recording, _ = simulate_statistical(ground, route, mission)
    found = localize_recording(recording, mission)
    if found.trajectory.error is None:
        raise ConfigError("the mission has no odometry, so that shared errors are not known; add it.")
    return found.points, found.trajectory.error, route


def planned_mission(mission: MissionConfig, world: World) -> Route:
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
