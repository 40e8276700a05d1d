"""Coverage of the levels of detection between two point clouds: ``python -m benchmarks.cloud_change``.

Drawn pairs of clouds on 60 x 60 m with a point every 0.5 m and 0.03 m of noise, of which the later one is displaced by 0.10 m
along the normal of the ground: flat, sloping, rough, and a cliff. In further rows the noise differs from what a level of
detection assumes, or one cloud is off by a registration error, which is stated or learned on the unchanged western half. Strips of
one real survey show no change: the error is learned on every second square of 20 m, or in the western half, and judged on the
rest. The distances are compared with those of py4dgeo where it is installed (``pip install py4dgeo``).
"""

import tempfile
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
import shapely
from scipy.ndimage import map_coordinates

from benchmarks.change_pairs import DATA
from benchmarks.change_worlds import exponential_field
from benchmarks.report import Row, cpu_seconds, main
from survey.core import BoolArray, FloatArray
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.scoring.differencing.cloud_change import change_of_clouds
from survey.scoring.differencing.m3c2 import CloudDistances, m3c2

_SIDE_M, _SIGMA_M, _MOVED_M = 60.0, 0.03, 0.10
_FIRST_SEED = 71_000
_CRS = "EPSG:32608"
_WEST = shapely.box(-1e3, -1e3, 0.0, 1e3)
_SQUARE_M = 20.0
_STRIPS = (
    ("gullied hill", "dem_gullies_santacruz_pozo/Blanca_in_Pozo_cl2_SC12.laz", (8706, 8705)),
    ("gullied hill", "dem_gullies_santacruz_pozo/Blanca_in_Pozo_cl2_SC12.laz", (8706, 8707)),
    ("wooded slope", "lidar_bcts_3strips/bcts_3.laz", (67, 68)),
)


class _World(NamedTuple):
    """Ground and errors of a pair of clouds.

    `slope_deg`: of the ground. `relief_m`: standard deviation of a relief that is correlated over 2 m. `per_m2`: points. `later`: noise
    of the later cloud over that of the earlier one. `shared_m`: standard deviation of errors of the later cloud that are correlated over
    10 m. `registration_m`: error of its place in each direction. `tails`: degrees of freedom of the noise. `outliers`: share of points
    that are 1 m off.
    """

    name: str
    slope_deg: float = 0.0
    relief_m: float = 0.0
    per_m2: float = 4.0
    later: float = 1.0
    shared_m: float = 0.0
    registration_m: float = 0.0
    tails: float = np.inf
    outliers: float = 0.0


class _Case(NamedTuple):
    """World, the registration error that is stated (None to learn it on the western half), and the bar of the coverage [%]."""

    world: _World
    stated_m: float | None
    least: float | None
    most: float = 100.0


_CASES = (
    _Case(_World("flat"), 0.0, 93.0, 97.0),
    _Case(_World("slope of 30°", 30.0), 0.0, 93.0, 97.0),
    _Case(_World("rough slope, relief of 0.15 m", 30.0, 0.15), 0.0, 93.0, 97.0),
    _Case(_World("cliff of 80°", 80.0), 0.0, 93.0, 97.0),
    _Case(_World("later cloud twice as noisy", 30.0, later=2.0), 0.0, 93.0, 97.0),
    _Case(_World("0.6 points per m²", 30.0, per_m2=0.6), 0.0, 93.0, 97.0),
    _Case(_World("noise of heavy tails (t of 3)", 30.0, tails=3.0), 0.0, 93.0, 98.0),
    _Case(_World("2 % of the points 1 m off", 30.0, outliers=0.02), 0.0, None),
    _Case(_World("registration error of 0.02 m, stated", 30.0, registration_m=0.02), 0.02, 93.0),
    _Case(_World("registration error of 0.02 m, stated as 0", 30.0, registration_m=0.02), 0.0, None),
    _Case(_World("registration error of 0.02 m, by unchanged ground", 30.0, registration_m=0.02), None, 93.0),
    _Case(_World("0.02 m shared over 10 m, stated as 0", 30.0, shared_m=0.02), 0.0, None),
    _Case(_World("0.02 m shared over 10 m, stated", 30.0, shared_m=0.02), 0.02, 93.0),
    _Case(_World("0.02 m shared over 10 m, by unchanged ground", 30.0, shared_m=0.02), None, 93.0),
)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    for case in _CASES:
        yield from _coverage(case, 6 if quick else 60)
    for name, file, strips in _STRIPS:
        yield from _strips(f"strips {strips[0]} and {strips[1]} of a {name}", DATA / file, strips)
    yield from _large(100_000 if quick else 1_000_000)
    if find_spec("py4dgeo") is not None:
        yield from _against_py4dgeo()


def _coverage(case: _Case, n_pairs: int) -> Iterator[Row]:
    """Yield how often errors are within the levels of detection, in all pairs and in the worst one, and the median level."""
    held, levels = [], []
    for seed in range(_FIRST_SEED, _FIRST_SEED + n_pairs):
        found, moved = _pair(case, seed)
        within = np.abs(found.distance_m - found.normals @ moved) <= found.lod_m
        judged = found.xyz[:, 0] > 0.0 if case.stated_m is None else np.ones(len(within), dtype=bool)
        held.append(within[judged])
        levels.append(float(np.median(found.lod_m[judged])))
    covered = 100.0 * float(np.concatenate(held).mean())
    name, bar = case.world.name, ""
    holds = None
    if case.least is not None:
        bar = f"{case.least:g} to {case.most:g}"
        holds = case.least <= covered <= case.most
    yield Row(f"{name}: 95 % level of detection holds ({n_pairs} pairs)", covered, "%", bar, holds)
    yield Row(f"{name}: in the worst pair", 100.0 * min(float(one.mean()) for one in held), "%")
    yield Row(f"{name}: level of detection, median", float(np.median(levels)), "m")


def _pair(case: _Case, seed: int) -> tuple[CloudDistances, FloatArray]:
    """Return the distances between two drawn clouds, and the true displacement (3,) [m]."""
    rng, world = stream(seed, "cloud change", case.world.name), case.world
    angle = np.deg2rad(world.slope_deg)
    normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    relief = world.relief_m * exponential_field(rng, 240, 8.0) if world.relief_m else None
    shared = world.shared_m * exponential_field(rng, 240, 40.0) if world.shared_m else None
    earlier = _cloud(world, rng, relief)
    moved = _MOVED_M * normal
    later = _cloud(world._replace(shared_m=0.0), rng, relief, noise_m=world.later * _SIGMA_M, shared=shared)
    later = later + moved + rng.normal(0.0, world.registration_m, 3)
    clouds = [SurfacePoints(xyz, sigma_m=1.0, crs=_CRS) for xyz in (later, earlier)]
    if case.stated_m is not None:
        return m3c2(*clouds, registration_m=case.stated_m), moved
    # The ground of the west did not move.
    still = np.where(later[:, :1] < 0.0, later - moved, later)
    clouds[0] = SurfacePoints(still, sigma_m=1.0, crs=_CRS)
    return change_of_clouds(*clouds, stable=_WEST).distances, moved


def _cloud(
    world: _World,
    rng: np.random.Generator,
    relief: FloatArray | None,
    *,
    noise_m: float = _SIGMA_M,
    shared: FloatArray | None = None,
) -> FloatArray:
    """Draw points (N, 3) on the ground [m]."""
    n = int(world.per_m2 * _SIDE_M**2)
    place = rng.uniform(0.0, _SIDE_M, (n, 2))
    up = np.zeros(n)
    for field in (relief, shared):
        if field is not None:
            up += map_coordinates(field, place.T * 239.0 / _SIDE_M, order=1)
    up += np.where(rng.random(n) < world.outliers, 1.0, 0.0)
    angle = np.deg2rad(world.slope_deg)
    along, across = (place - _SIDE_M / 2.0).T
    xyz = np.column_stack(
        [
            along * np.cos(angle) - up * np.sin(angle),
            across,
            along * np.sin(angle) + up * np.cos(angle),
        ]
    )
    tails = world.tails
    drawn = rng.standard_normal((n, 3)) if np.isinf(tails) else rng.standard_t(tails, (n, 3))
    return xyz + noise_m * drawn


def _strips(name: str, file: Path, strips: tuple[int, int]) -> Iterator[Row]:
    """Yield how often two strips of one survey differ by less than the levels of detection in the eastern half."""
    if not file.exists():
        return
    las = laspy.read(file, laz_backend=laspy.LazBackend.Lazrs)
    with tempfile.TemporaryDirectory() as folder:
        clouds = []
        for strip in strips:
            one = laspy.LasData(las.header)
            one.points = las.points[np.asarray(las.point_source_id) == strip].copy()
            one.write(str(Path(folder) / f"{strip}.las"))
            clouds.append(SurfacePoints.read(Path(folder) / f"{strip}.las", sigma_m=1.0))
    plain = m3c2(*clouds, registration_m=0.0)
    yield from _strip_rows(
        f"{name}, registration stated as 0", plain, np.ones(len(plain.distance_m), dtype=bool)
    )
    (west, south), (east, north) = plain.xyz[:, :2].min(axis=0) - 1.0, plain.xyz[:, :2].max(axis=0) + 1.0
    corners = np.stack(
        np.meshgrid(np.arange(west, east, _SQUARE_M), np.arange(south, north, _SQUARE_M)), axis=-1
    )
    squares = [
        shapely.box(x, y, x + _SQUARE_M, y + _SQUARE_M)
        for row, line in enumerate(corners)
        for x, y in line[row % 2 :: 2]
    ]
    half = shapely.box(west, south, float(np.median(plain.xyz[:, 0])), north)
    for how, stable in (
        ("by every second square", shapely.MultiPolygon(squares)),
        ("by the western half", half),
    ):
        found = change_of_clouds(*clouds, stable=stable).distances
        yield from _strip_rows(
            f"{name}, registration {how}", found, ~shapely.contains_xy(stable, *found.xyz[:, :2].T)
        )


def _strip_rows(name: str, found: CloudDistances, judged: BoolArray) -> Iterator[Row]:
    """Yield how often distances are within the levels of detection where they are judged (N,)."""
    within = np.abs(found.distance_m) <= found.lod_m
    yield Row(f"{name}: 95 % level of detection holds", 100.0 * float(within[judged].mean()), "%")
    yield Row(f"{name}: level of detection, median", float(np.median(found.lod_m[judged])), "m")
    yield Row(f"{name}: distance, median", float(np.median(found.distance_m[judged])), "m")


def _large(n: int) -> Iterator[Row]:
    """Yield the CPU time of two large clouds."""
    rng = stream(_FIRST_SEED, "large clouds")
    reach = np.sqrt(n) / 4.0
    clouds = []
    for _ in range(2):
        xy = rng.uniform(-reach, reach, (n, 2))
        xyz = np.column_stack([xy, 5.0 * np.sin(xy[:, 0] / 40.0)]) + rng.normal(0.0, _SIGMA_M, (n, 3))
        clouds.append(SurfacePoints(xyz, sigma_m=1.0, crs=_CRS))
    m3c2(
        clouds[0].select(np.arange(5000)), clouds[1].select(np.arange(5000)), registration_m=0.0, depth_m=50.0
    )
    found, seconds = cpu_seconds(lambda: m3c2(*clouds, registration_m=0.0))
    yield Row.of(
        f"two clouds of {n:,} points, {len(found.distance_m):,} core points", seconds, "CPU-s", "<=", 60.0
    )


def _against_py4dgeo() -> Iterator[Row]:
    """Yield differences from py4dgeo with the same lengths, and the ratio of the CPU times."""
    import py4dgeo

    rng = stream(_FIRST_SEED, "py4dgeo")
    world = _World("rough", 30.0, 0.15, per_m2=40.0)
    relief = world.relief_m * exponential_field(rng, 240, 8.0)
    new, old = (_cloud(world, rng, relief) for _ in range(2))
    lengths = {"normals_m": (2.0,), "cylinder_m": 1.0, "depth_m": 2.0, "spacing_m": 1.0}
    run: Callable[[], CloudDistances] = lambda: m3c2(  # noqa: E731
        *(SurfacePoints(xyz, sigma_m=1.0, crs=_CRS) for xyz in (new, old)), registration_m=0.02, **lengths
    )
    run()
    found, seconds = cpu_seconds(run)
    peer = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(old), py4dgeo.Epoch(new)),
        corepoints=found.xyz,
        normal_radii=(1.0,),
        cyl_radius=0.5,
        max_distance=2.0,
        registration_error=0.02,
    )
    (distances, errors), peer_seconds = cpu_seconds(peer.run)
    n_later, n_earlier = errors["num_samples2"], errors["num_samples1"]
    same = (n_earlier == found.n_earlier) & (n_later == found.n_later)
    # The core point is a point of the earlier cloud, and lies on the border of two of py4dgeo's searches.
    but_core = (np.abs(n_earlier.astype(np.int64) - found.n_earlier) <= 1) & (n_later == found.n_later)
    yield Row("py4dgeo: same points in both cylinders", 100.0 * float(same.mean()), "%")
    yield Row("py4dgeo: same points but one of the earlier cloud", 100.0 * float(but_core.mean()), "%")
    off = np.abs(distances - found.distance_m)
    yield Row.of(
        "py4dgeo: largest difference of distances with the same points", off[same].max(), "m", "<=", 1e-9
    )
    yield Row("py4dgeo: difference of distances elsewhere, 95 %", float(np.quantile(off[~same], 0.95)), "m")
    ratio = found.lod_m[same] / errors["lodetection"][same]
    yield Row("py4dgeo: ratio of the levels of detection, median", float(np.median(ratio)), "1")
    yield Row("py4dgeo: ratio of the CPU times (ours / theirs)", seconds / peer_seconds, "1")


if __name__ == "__main__":
    main("Cloud change", measure, ("numpy", "scipy", "numba", "py4dgeo"))
