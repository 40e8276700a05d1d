"""Space-carving kernels: time, growth, what lines of sight are worth, and what they do to real scans.

Run: python -m benchmarks.space_carving [--quick] [--json FILE]

Terrains, settings and gates were chosen on seeds 100 to 105 and on blocks 11 to 16 of the real scans; what is
printed comes from seeds 0, 1 and 2 and from other blocks. The peer is scikit-learn's Gaussian process with its
hyperparameters given, so that none of its time goes into finding them. Whether bounds hold, and what they cost,
is `benchmarks.space_carving_bounds`.
"""

from collections.abc import Callable, Iterator

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel

from benchmarks.report import Row, cpu_seconds, fastest, main
from benchmarks.terrain_lattice_honesty import BLOCK_M, REAL_SIGMA_M, SHARE
from benchmarks.terrain_lattice_honesty import _real_scans as real_scans
from papers.carving.comparison import REGIMES, SEEDS, errors
from papers.carving.world import CRS, HALF_M, N_TRAIN, TERRAINS, ScanTrial
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
from survey.reconstruction.lattice.calibration import left_out_blocks

PACKAGES = ("numpy", "scipy", "numba", "scikit-learn")
N_PEER = 3000
ROUGH = tuple(TERRAINS)[:3]
GAINS = {"short reach": (("test", 35.0), ("grid", 50.0))}
GRID_GAINS_FROM_5M = {"downhill": 10.0, "hilly": 10.0}
WORSE_PERCENT = 3.0
KEPT = 0.95
"""Share of the squared errors on real ground that counts: the rest are points that are no ground."""
SURFACE = SpaceCarvingConfig(bounds=False)


def measure(quick: bool) -> Iterator[Row]:
    """Yield all rows."""
    yield from times(quick)
    yield from growth(quick)
    yield from gains(SEEDS[:1] if quick else SEEDS)
    yield from real((1,) if quick else (1, 2, 3, 4))


def times(quick: bool) -> Iterator[Row]:
    """CPU time of 10,000 points in eight passes, beside scikit-learn's Gaussian process on 3,000 of them."""
    ratios = {}
    for name in ROUGH[:1] if quick else ROUGH:
        trial = ScanTrial.new(name, SEEDS[0])
        SpaceCarvingKernel().fit(trial.train.select(np.arange(len(trial.train)) < 500))
        one, seconds = fastest(lambda t=trial: SpaceCarvingKernel(SURFACE).fit(t.train), 3)
        _, three = cpu_seconds(lambda t=trial: SpaceCarvingKernel().fit(t.train))
        _, peer = fastest(lambda t=trial: _peer(t), 1 if quick else 3)
        by_points, by_rays = one.n_bases()
        yield Row(f"{name}: one surface, {N_TRAIN:,} points, 8 passes", seconds, "s")
        yield Row(f"{name}: all three surfaces", three, "s")
        yield Row(f"{name}: bases", by_points + by_rays, "")
        yield Row(f"{name}: Gaussian process, {N_PEER:,} points", peer, "s")
        ratios[name] = seconds / peer
        yield Row(f"{name}: three surfaces over the Gaussian process", three / peer, "")
    yield Row.of("one surface over the Gaussian process, worst terrain", max(ratios.values()), "", "<=", 0.6)


def _peer(trial: ScanTrial) -> FloatArray:
    """Fit scikit-learn's Gaussian process with its hyperparameters given, and ask it for nothing."""
    points = trial.train.xyz[:N_PEER]
    kernel = 0.5 * RBF(2.0) + WhiteKernel(4e-4)
    model = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True)
    model.fit(points[:, :2], points[:, 2])
    heights: FloatArray = model.predict(trial.test.xy[:1])
    return heights


def growth(quick: bool) -> Iterator[Row]:
    """CPU time of one surface over ever larger ground, equally dense, to a million points."""
    seconds = {}
    tiles = (1, 3) if quick else (1, 3, 10)
    hilly = ScanTrial.new("hilly", SEEDS[0])
    for k in tiles:
        points = _tiled(hilly, k)
        model, seconds[k] = cpu_seconds(lambda p=points: SpaceCarvingKernel(SURFACE).fit(p))
        yield Row(f"{len(points):,} points: one surface", seconds[k], "s")
        yield Row(f"{len(points):,} points: a point", 1e6 * seconds[k] / len(points), "µs")
        yield Row(f"{len(points):,} points: RMSE at the points", model.spread_m_, "m")
    last = tiles[-1]
    exponent = float(np.log(seconds[last] / seconds[1]) / np.log(last**2))
    yield Row.of(f"time grows as points to the power of, to {last**2 * N_TRAIN:,}", exponent, "", "<=", 1.1)


def _tiled(trial: ScanTrial, k: int) -> SurfacePoints:
    """Return k × k copies of a scan side by side, each with its sensor."""
    steps = 2.0 * HALF_M * np.arange(k)
    shifts = np.column_stack([axis.ravel() for axis in np.meshgrid(steps, steps)] + [np.zeros(k * k)])
    origins = trial.train.origins
    assert origins is not None
    xyz = (trial.train.xyz + shifts[:, None]).reshape(-1, 3)
    return SurfacePoints(
        xyz, sigma_m=trial.train.sigma_z[0], origins=(origins + shifts[:, None]).reshape(-1, 3), crs=CRS
    )


def gains(seeds: tuple[int, ...]) -> Iterator[Row]:
    """How far lines of sight lower the mean square error on five terrains, in every regime."""
    worst: dict[str, float] = {}
    for regime_name, regime in REGIMES.items():
        rough = []
        for terrain in TERRAINS:
            pairs = np.array([errors(ScanTrial.new(terrain, seed), regime) for seed in seeds])
            mean = pairs.mean(axis=0)
            rough += [mean] if terrain in ROUGH else []
            changes = 100.0 * (pairs[:, 1] / pairs[:, 0] - 1.0)
            worst[f"{regime_name}, {terrain}"] = float((100.0 * (mean[1] / mean[0] - 1.0)).max())
            for j, where in enumerate(("test", "grid")):
                name = f"{regime_name}, {terrain}, {where}"
                yield Row(f"{name}: without rays", mean[0, j], "m²")
                gain = 100.0 * (1.0 - mean[1, j] / mean[0, j])
                limit = GRID_GAINS_FROM_5M.get(terrain) if regime_name == "5 m" and where == "grid" else None
                title = f"{name}: rays cut"
                yield Row.of(title, gain, "%", ">=", limit) if limit else Row(title, gain, "%")
                yield Row(f"{name}: worst seed's change", float(changes[:, j].max()), "%")
        without, carved = np.mean(rough, axis=0)
        for (where, limit), j in zip(GAINS.get(regime_name, ()), (0, 1), strict=False):
            gain = 100.0 * (1.0 - carved[j] / without[j])
            yield Row.of(f"{regime_name}, rough terrains, {where}: rays cut", gain, "%", ">=", limit)
    place = max(worst, key=worst.__getitem__)
    yield Row.of(f"simulated, worst change ({place})", worst[place], "%", "<=", WORSE_PERCENT)


def real(draws: tuple[int, ...]) -> Iterator[Row]:
    """Judge lines of sight on real scans: trimmed errors on other points of the scan, and on blocks left out."""
    worst: dict[str, float] = {}
    for name, xyz in real_scans().items():
        sums = np.mean([_real_errors(xyz, draw) for draw in draws], axis=0)
        for j, where in enumerate(("same scan", "blocks")):
            yield Row(f"real, {name}, {where}: without rays", sums[0, j], "m²")
            change = float(100.0 * (sums[1, j] / sums[0, j] - 1.0))
            yield Row(f"real, {name}, {where}: rays change", change, "%")
            worst[f"{name}, {where}"] = change
    if worst:
        place = max(worst, key=worst.__getitem__)
        yield Row.of(f"real, worst change ({place})", worst[place], "%", "<=", WORSE_PERCENT)


def _real_errors(xyz: FloatArray, draw: int) -> FloatArray:
    """Return trimmed mean square errors, without and with rays, on points of the same scan and on blocks."""
    out = left_out_blocks(xyz[:, :2], BLOCK_M, SHARE, 1000 + draw)
    shown = stream(draw, "space carving", "real").permutation(np.flatnonzero(~out))
    n_test = min(len(shown) // 5, 5000)
    same, train = xyz[shown[:n_test]], xyz[shown[n_test : n_test + N_TRAIN]]
    points = SurfacePoints(train, sigma_m=REAL_SIGMA_M, origins=np.zeros_like(train), crs=CRS)

    def trimmed(predict: Callable[[FloatArray], FloatArray], asked: FloatArray) -> float:
        squared = np.sort((predict(asked[:, :2]) - asked[:, 2]) ** 2)
        return float(squared[: int(KEPT * len(squared))].mean())

    models = [
        SpaceCarvingKernel(SURFACE.model_copy(update={"carve": carve})).fit(points) for carve in (False, True)
    ]
    return np.array([[trimmed(model.predict, asked) for asked in (same, xyz[out])] for model in models])


if __name__ == "__main__":
    main("space carving", measure, PACKAGES)
