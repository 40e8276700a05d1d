"""Whether the field lattice's claims hold on blocks of ground that it was not shown."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.ndimage import generic_filter

from benchmarks.report import Row
from papers.emap.world import EmapRun, sine_hills
from survey.core.arrays import BoolArray, FloatArray
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.calibration import left_out_blocks
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.terrain.random_fields import fractional_brownian, matern_field, squared_exponential_field

BLOCK_M, SHARE, THIN_M = 1.0, 0.15, 0.5
SEED = 2
N_SCANS = 4
REAL_REACH_M, REAL_SIGMA_M, ABOVE_GROUND_M = 15.0, 0.03, 0.4
# What may be ground in the labels of RELLIS-3D: dirt, grass, asphalt, concrete, puddle, mud.
RELLIS_GROUND = (1, 3, 10, 23, 31, 33)
CRS = "EPSG:32608"
_SITE = Grid((-16.0, -16.0, 18.0, 18.0), 0.125, CRS)

Height = Callable[[FloatArray], FloatArray]


def honesty(quick: bool) -> Iterator[Row]:
    """Normalised squared error and coverage of held-out blocks, on six terrains and on real scans."""
    draws = (1,) if quick else (1, 2, 3, 4)
    terrains = list(_terrains().items())
    yield from _rows("simulated", {n: _simulated(h) for n, h in terrains[: 5 if quick else 6]}, 0.05, draws)
    real = _real_scans()
    if real:
        yield from _rows("real", real, REAL_SIGMA_M, draws)


def _rows(kind: str, clouds: dict[str, FloatArray], sigma_m: float, draws: tuple[int, ...]) -> Iterator[Row]:
    """Judge every cloud; the bars are the worst one's."""
    scores = {name: np.concatenate([scores_of(c, sigma_m, k) for k in draws]) for name, c in clouds.items()}
    nis = {name: float(np.mean(z**2)) for name, z in scores.items()}
    coverage = {name: float(np.mean(np.abs(z) <= 1.96)) for name, z in scores.items()}
    for name, z in scores.items():
        yield Row(f"{kind}, {name}: NIS of {len(z)} held-out points", nis[name], "")
        kept = np.sort(z**2)[: int(0.99 * len(z))]
        yield Row(f"{kind}, {name}: NIS without the worst hundredth", float(kept.mean()), "")
        yield Row(f"{kind}, {name}: within 95 %", coverage[name], "")
    yield Row.of(f"{kind}: largest NIS", max(nis.values()), "", "<=", 1.5)
    yield Row.of(f"{kind}: smallest NIS", min(nis.values()), "", ">=", 0.7)
    yield Row.of(f"{kind}: least within 95 %", min(coverage.values()), "", ">=", 0.92)
    yield Row.of(f"{kind}: most within 95 %", max(coverage.values()), "", "<=", 0.98)


def scores_of(xyz: FloatArray, sigma_m: float, draw: int) -> FloatArray:
    """Return the standardised errors (M,) at one point per cell of the blocks held out."""
    out = left_out_blocks(xyz[:, :2], BLOCK_M, SHARE, 1000 + draw)
    model = FieldLattice().fit(SurfacePoints(xyz[~out], sigma_m=sigma_m, crs=CRS))
    asked = xyz[out][_one_per_cell(xyz[out])]
    variance = model.predict(asked[:, :2], "std") ** 2
    noise_m = model.calibration.points * model.stiffness_.noise_factor * sigma_m
    scores: FloatArray = (asked[:, 2] - model.predict(asked[:, :2])) / np.sqrt(variance + noise_m**2)
    return scores[np.isfinite(scores)]


def _one_per_cell(xyz: FloatArray) -> FloatArray:
    cells = np.floor(xyz[:, :2] / THIN_M).astype(np.int64)
    first: FloatArray = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    return first


def _terrains() -> dict[str, Height]:
    """Return six terrains: the paper's, a plane, three random ones, and piles."""
    random = {
        "fractal": lambda rng: fractional_brownian(_SITE, rng, relief_m=2.5).elevation,
        "Matérn": lambda rng: matern_field(_SITE, rng, relief_m=2.5, length_scale_m=4.0).elevation,
        "smooth": lambda rng: (
            squared_exponential_field(_SITE, rng, relief_m=3.0, length_scale_m=4.0).elevation
        ),
        "piles": _piles,
    }
    drawn = {name: make(stream(SEED, "terrain lattice", name)) for name, make in random.items()}
    fixed: dict[str, Height] = {
        "sine hills": sine_hills,
        "plane": lambda xy: 0.1 * xy[:, 0] - 0.05 * xy[:, 1],
    }
    return fixed | {name: _height(z - np.median(z)) for name, z in drawn.items()}


def _piles(rng: np.random.Generator) -> FloatArray:
    xy = _SITE.xy
    z = np.zeros(len(xy))
    for x, y, height in zip(
        rng.uniform(-14, 14, 25), rng.uniform(-14, 14, 25), rng.uniform(0.3, 1.0, 25), strict=True
    ):
        z = np.maximum(z, height - 0.8 * np.hypot(xy[:, 0] - x, xy[:, 1] - y))
    return z.reshape(_SITE.shape)


def _height(z: FloatArray) -> Height:
    dem = Dem.on(_SITE, z)
    return lambda xy: np.nan_to_num(dem.at(xy))


def _simulated(height: Height) -> FloatArray:
    return np.concatenate([points.xyz for _, points in EmapRun(height=height, n_scans=N_SCANS).scans()])


def _real_scans() -> dict[str, FloatArray]:
    """Return the ground within 15 m of real sensors: by label where there are labels, else near the median of minima."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FIRNLINE_DATA", default)) / "lidar_scans"
    clouds = {}
    for file in sorted([*folder.glob("rellis*.npz"), *folder.glob("lpm*.npz")]):
        with np.load(file) as stored:
            xyz = stored["points"].astype(np.float64)
            label = stored["label"] if "label" in stored.files else None
        near = (np.abs(xyz[:, :2]) < REAL_REACH_M).all(axis=1)
        ground = near & (_near_minima(xyz, near) if label is None else np.isin(label, RELLIS_GROUND))
        clouds[file.stem] = xyz[ground]
    return clouds


def _near_minima(xyz: FloatArray, near: BoolArray) -> BoolArray:
    """Return which points lie within 0.4 m of the median of the lowest points of the 1 m cells around."""
    cells = np.floor(xyz[:, :2] + REAL_REACH_M).astype(np.int64)
    n = int(2 * REAL_REACH_M)
    lowest = np.full((n, n), np.inf)
    np.minimum.at(lowest, tuple(cells[near].T), xyz[near, 2])
    lowest[np.isinf(lowest)] = np.nan
    for size in (5, 3):
        lowest = generic_filter(lowest, _median, size=size, mode="constant", cval=np.nan)
    level = np.full(len(xyz), np.nan)
    level[near] = lowest[tuple(cells[near].T)]
    found: BoolArray = np.abs(xyz[:, 2] - level) < ABOVE_GROUND_M
    return found


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
