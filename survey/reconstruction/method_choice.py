"""Choice between triangles and the Gaussian process by points that are left out.

Where points are dense, triangles may err as little as the Gaussian process, at a hundredth of its cost. `compare_methods`
leaves out up to 1,000 points and predicts them from the points around them, by triangles and by the likeliest kernel; by
a simple one alone where that errs far less than triangles do.
Triangles are taken where their error, less the noise of the points left out, is at most 1.06 times that of the kernel, and
where the nodes lie no farther from points than those that were left out.

`MethodChoice.recorded` adds what the surface does between points to the deviation of triangles: the excess of the squared
errors, by the distance to the nearest point.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from survey.core import BoolArray, FloatArray, stream
from survey.data import Dem, Grid, SurfacePoints, SurveyArea
from survey.reconstruction.gp.engine_choice import is_little_work
from survey.reconstruction.gp.kernel_average import MEMBERS, Member, averaged_kernels
from survey.reconstruction.gp.marginal_likelihood import are_wide
from survey.reconstruction.methods.triangulation import Triangles
from survey.reconstruction.observations import Observations
from survey.reconstruction.terrain_map import ELEVATION, INTERPOLATED, METHOD_CHOICE, Reconstruction

# Ratio of errors that counts as equal, most points left out and their share, and points that predict each.
_AS_GOOD, _MOST_LEFT_OUT, _SHARE_LEFT_OUT, _N_AROUND = 1.06, 1000, 0.1, 80
# Ratio of errors beyond which no other kernel is fitted.
_FAR_BETTER = 1.3
# Share of the nodes that may lie farther from points than nearly all that were left out; ranges of that distance.
_SHARE_FARTHER, _NEARLY_ALL, _N_RANGES = 0.05, 0.99, 4


@dataclass(frozen=True)
class MethodChoice:
    """The method, why, and what the surface does between points.

    `tin_m`, `gp_m`: root mean square errors at the points left out, less their noise [m]. `distance_m`, `relief_m2` (K,):
    distances to the nearest point [m], and variance of the surface about triangles there [m²]. `rise`: root mean square
    difference of neighbours over their distance.
    """

    method: str
    sentence: str
    tin_m: float
    gp_m: float
    distance_m: tuple[float, ...]
    relief_m2: tuple[float, ...]
    rise: float

    def recorded(self, result: Reconstruction, points: SurfacePoints) -> Reconstruction:
        """Return a map with the choice in its record; nodes beyond triangles take the height of the nearest point."""
        facts = {**result.diagnostics, METHOD_CHOICE: asdict(self)}
        if self.method != "tin":
            return replace(result, diagnostics=facts)
        facts.pop("standard_deviation")
        data, grid = Observations.of(points, result.quantity), result.mean.grid()
        distance, nearest = map(np.asarray, cKDTree(data.xy).query(grid.xy))
        height, std = result.mean.elevation.ravel(), result.std.elevation.ravel()
        beyond = np.isnan(height)
        variance = std**2 + np.interp(distance, (0.0, *self.distance_m), (0.0, *self.relief_m2))
        variance[beyond] = data.variance[nearest[beyond]] + (self.rise * distance[beyond]) ** 2
        maps = np.where(beyond, data.z[nearest], height), np.sqrt(variance)
        mean, spread = (Dem.on(grid, each.reshape(grid.shape), result.mean.vertical_datum) for each in maps)
        support = np.where(beyond.reshape(grid.shape), INTERPOLATED, result.support)
        return replace(result, mean=mean, std=spread, support=support, diagnostics=facts)


@threadpool_limits.wrap(limits=1, user_api="blas")
def compare_methods(
    points: SurfacePoints, grid: Grid, area: SurveyArea | None = None, quantity: str = ELEVATION
) -> MethodChoice | None:
    """Return the choice for a map without a prior; None where the points are few, so that the Gaussian process costs little."""
    data = Observations.of(points, quantity).merged()
    if is_little_work(len(data), grid.shape[0] * grid.shape[1]) or not are_wide(data.xy):
        return None
    n_out, tree = min(int(_SHARE_LEFT_OUT * len(data)), _MOST_LEFT_OUT), cKDTree(data.xy)
    out = stream(0, "choice of a method").permutation(len(data))[:n_out]
    kept = np.setdiff1d(tree.query(data.xy[out], k=_N_AROUND)[1], out)
    around, left_out = (Observations(data.xy[k], data.z[k], data.variance[k]) for k in (kept, out))
    height, std = Triangles.of(around).at(left_out.xy)
    known = np.isfinite(height)

    def excess(found: FloatArray) -> FloatArray:
        squared: FloatArray = ((found - left_out.z) ** 2 - left_out.variance)[known]
        return squared

    of_tin, tin_m, gp_m = excess(height), _root_mean(excess(height)), np.inf
    for members in (MEMBERS[:1], MEMBERS):
        if np.isinf(gp_m) or 0.0 < tin_m <= _FAR_BETTER * gp_m:
            gp_m = _root_mean(excess(_by_kernel(around, left_out.xy, members)))
    distance, nearest = map(np.asarray, cKDTree(around.xy).query(left_out.xy))
    steps = (left_out.z - around.z[nearest]) ** 2 - left_out.variance - around.variance[nearest]

    def is_farther() -> BoolArray:
        seen = grid.xy if area is None else grid.xy[area.contains(grid.xy)]
        farther: BoolArray = np.asarray(tree.query(seen)[0]) > np.quantile(distance, _NEARLY_ALL)
        return farther

    is_tin = 0.0 < tin_m <= _AS_GOOD * gp_m and float(np.mean(is_farther())) <= _SHARE_FARTHER
    method = "tin" if is_tin else "gp"
    sentence = f"{method}, for {_reason(n_out, tin_m, gp_m)}"
    sentence += "; --method gp maps by the Gaussian process" if is_tin else ""
    relief = _by_distance(distance[known], of_tin - std[known] ** 2)
    rise = float(np.sqrt(max(steps.mean(), 0.0) / np.mean(distance**2)))
    return MethodChoice(method, sentence, tin_m, gp_m, *relief, rise)


def _reason(n_out: int, tin_m: float, gp_m: float) -> str:
    """Return what the points left out show of both methods."""
    if tin_m == gp_m == 0.0:
        return (
            f"at {n_out} points left out neither method errs by more than the stated standard deviations, which triangles "
            "do not average"
        )
    return (
        f"at {n_out} points left out triangles err by {tin_m:.3g} m and the Gaussian process by {gp_m:.3g} m"
    )


def _root_mean(squared: FloatArray) -> float:
    return float(np.sqrt(max(squared.mean(), 0.0)))


def _by_kernel(data: Observations, xy: FloatArray, members: Sequence[Member]) -> FloatArray:
    """Return the heights (M,) at places by the likeliest kernel of the members, from the nearest points."""
    from survey.reconstruction.gp.engines.local_gp import LocalGaussianProcess  # compiled support

    z = data.z - data.z.mean()
    best = averaged_kernels(data.xy, z, data.variance, members=members).kernels[0]
    sigma = np.sqrt(data.variance + best.nugget_m**2)
    process = LocalGaussianProcess.fit(data.xy, z, sigma, best.kernel, trend="constant")
    return np.asarray(process.predict(xy)[0] + data.z.mean())


def _by_distance(distance: FloatArray, excess: FloatArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the mean distance of each range [m], and the mean excess there [m²], 0 at least and nowhere falling."""
    rows = np.array_split(np.argsort(distance, kind="stable"), _N_RANGES)
    rising = np.maximum.accumulate([max(excess[here].mean(), 0.0) for here in rows])
    return tuple(float(distance[here].mean()) for here in rows), tuple(rising.tolist())
