"""Judge surfaces of walls that overhang: ``python -m benchmarks.free_nodes``.

Simulated scans of leaning seracs, undercut walls and glacier tables with sharp edges (`benchmarks.overhang_scenes`), from five places. In the
rows that differ poses err twice as much as stated and beams are three times wider, so that more returns mix two surfaces. Errors are
distances of the true surface from the estimated one, on vertical sections, where a return is within 0.15 m (seen), and elsewhere
within reach (unseen). On the same points and sections, within the plane: the field lattice, the spring lattice of the EMap paper, and OctoMap,
whose surface are the centres of its occupied voxels. 95 % of the true places lie in their intervals if standard deviations are honest.

No setting was chosen on these seeds. Seeds 1 and 2 served to develop; three sites of seeds 700 to 702 were seen before errors that scans share
were taken from what points state. Real scans, of a street and of a trail, have no truth: there a tenth of the points is left out, and the distance of those points is divided by what surface
and points state. The table goes to ``results/benchmarks/free_nodes.json``; it takes about four minutes of CPU.
"""

import json
import os
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from benchmarks.overhang_scenes import CRS_OF_SCENES, HALF_M, SCENES, STATED, WRONG, scan
from benchmarks.writer import TABLES, Run
from survey.core import BoolArray, FloatArray
from survey.core.executors import run_all
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.free_lattice import beam_covariance, free_lattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.terrain_map import SIGMAS_95

RESULT = TABLES / "free_nodes.json"
DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[2] / "shared" / "data"))
N_SITES, FIRST_SEED, N_WORKERS = 2, 900, 1
STEP_M, SEEN_M, WITHIN_M = 0.25, 0.15, 5.8
SECTIONS_M = (-1.5, -0.7, 0.03, 0.8, 1.6)
REAL = ("lpm_cloud0", "lpm_cloud1", "lpm_cloud2", "rellis_os1_000104")
REAL_RANGE_M, REAL_NOISE_M = 12.0, 0.03
BARS = {"rmse_seen_m": 0.15, "within_95_seen": (0.93, 0.97), "cpu_over_field": 4.0}


class Site(NamedTuple):
    """One scene: its kind, whether the scanner differs from what is stated, and its seed."""

    scene: str
    differs: bool
    seed: int


class Score(NamedTuple):
    """Distances of the true surface [m], which of them are seen, distances over standard deviations, errors of peers, and CPU times [s]."""

    distance_m: FloatArray
    is_seen: BoolArray
    scaled: FloatArray
    peers: dict[str, FloatArray]
    cpu_s: float
    field_cpu_s: float
    unsupported: float


def judge(site: Site) -> Score:
    """Scan a scene, estimate its surface by all methods, and compare sections."""
    mesh = SCENES[site.scene](stream(site.seed, "free nodes", site.scene))
    points = scan(mesh, WRONG if site.differs else STATED, site.seed)
    places = [mesh.section(y) for y in SECTIONS_M]
    places = [line[np.abs(line[:, :2]).max(axis=1) <= WITHIN_M] for line in places]
    began = time.process_time()
    surface = free_lattice(points, STEP_M)
    cpu_s = time.process_time() - began
    everywhere = np.vstack(places)
    found = surface.distances(everywhere)
    is_seen = np.asarray(cKDTree(points.xyz).query(everywhere)[0]) <= SEEN_M
    began = time.process_time()
    field = FieldLattice(FieldLatticeConfig(step_m=STEP_M)).fit(points)
    field.predict(points.xy[:1], "std")
    field_cpu_s = time.process_time() - began
    springs = SpringLattice(SpringLatticeConfig(side_m=None, step_m=STEP_M))
    for scanned in _scans(points):
        springs.update(scanned)
    peers = {
        "free nodes": np.concatenate([_in_plane(surface.section((-HALF_M, y), (HALF_M, y)), line) for y, line in zip(SECTIONS_M, places, strict=True)]),
        "field lattice": np.concatenate([_below_heights(field, line) for line in places]),
        "EMap": np.concatenate([_below_heights(springs, line) for line in places]),
        "OctoMap 0.10 m": _voxels(points, everywhere, 0.10),
        "OctoMap 0.25 m": _voxels(points, everywhere, 0.25),
    }  # fmt: skip
    scaled = found.distance_m / found.sigma_m
    unsupported = float((~found.is_supported[~is_seen]).mean()) if (~is_seen).any() else float("nan")
    return Score(found.distance_m, is_seen, scaled, peers, cpu_s, field_cpu_s, unsupported)


def _scans(points: SurfacePoints) -> list[SurfacePoints]:
    """Divide points by the places of the scanner."""
    assert points.origins is not None
    _, number = np.unique(points.origins, axis=0, return_inverse=True)
    return [points.select(number.ravel() == k) for k in range(int(number.max()) + 1)]


def _in_plane(section: Any, line: FloatArray) -> FloatArray:
    """Return the distances of true places (K, 3) from the lines of a section along x [m]."""
    ends = np.stack([section.along_m - HALF_M, section.z_m], axis=-1)
    lines = shapely.multilinestrings(shapely.linestrings(ends))
    return np.asarray(shapely.distance(shapely.points(line[:, [0, 2]]), lines))


def _below_heights(model: FieldLattice | SpringLattice, line: FloatArray) -> FloatArray:
    """Return the distances of true places (K, 3) of one section from a map of heights [m]."""
    x = np.arange(-HALF_M, HALF_M + 0.01, 0.01)
    z = model.predict(np.column_stack([x, np.full_like(x, line[0, 1])]))
    profile = shapely.linestrings(np.column_stack([x, z])[np.isfinite(z)])
    return np.asarray(shapely.distance(shapely.points(line[:, [0, 2]]), profile))


def _voxels(points: SurfacePoints, places: FloatArray, resolution_m: float) -> FloatArray:
    """Return the distances of places (K, 3) from the nearest centre of an occupied voxel of OctoMap [m]."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import octomap

    tree = octomap.OcTree(resolution_m)
    for scanned in _scans(points):
        assert scanned.origins is not None
        tree.insertPointCloud(
            np.ascontiguousarray(scanned.xyz), np.array(scanned.origins[0]), STATED.reach_m + 1.0
        )
    hit = (np.unique(np.floor(points.xyz / resolution_m), axis=0) + 0.5) * resolution_m
    occupied = hit[np.asarray(tree.getLabels(np.ascontiguousarray(hit))) == 1]
    return np.asarray(cKDTree(occupied).query(places)[0])


def _rms(values: FloatArray) -> float:
    return round(float(np.sqrt(np.mean(values**2))), 3) if len(values) else float("nan")


def row_of(scores: list[Score]) -> dict[str, Any]:
    """Return the scores over several sites."""
    seen = np.concatenate([score.is_seen for score in scores])
    distance = np.abs(np.concatenate([score.distance_m for score in scores]))
    within = np.abs(np.concatenate([score.scaled for score in scores])) <= SIGMAS_95
    by_site = [float((np.abs(score.scaled[score.is_seen]) <= SIGMAS_95).mean()) for score in scores]
    peers = {name: np.concatenate([score.peers[name] for score in scores]) for name in scores[0].peers}
    return {
        "sites": len(scores),
        "rmse_seen_m": _rms(distance[seen]),
        "rmse_seen_worst_m": max(_rms(score.distance_m[score.is_seen]) for score in scores),
        "p95_seen_m": round(float(np.quantile(distance[seen], 0.95)), 3),
        "max_seen_m": round(float(distance[seen].max()), 3),
        "within_95_seen": round(float(within[seen].mean()), 3),
        "within_95_seen_worst": round(min(by_site), 3),
        "unseen_share": round(float((~seen).mean()), 3),
        "rmse_unseen_m": _rms(distance[~seen]),
        "within_95_unseen": round(float(within[~seen].mean()), 3),
        "unseen_stated_unsupported": round(float(np.nanmean([score.unsupported for score in scores])), 3),
        "section_rmse_seen_m": {name: _rms(error[seen]) for name, error in peers.items()},
        "cpu_s": round(float(np.mean([score.cpu_s for score in scores])), 2),
        "cpu_over_field": round(sum(s.cpu_s for s in scores) / sum(s.field_cpu_s for s in scores), 2),
    }


def real_row(name: str) -> dict[str, Any]:
    """Leave out a tenth of the points of a real scan, and compare them with the surface through the others."""
    with np.load(DATA / "lidar_scans" / f"{name}.npz") as file:
        xyz, origin = file["points"].astype(np.float64), file["origin"].astype(np.float64)
    range_m = np.linalg.norm(xyz - origin, axis=1)
    xyz = xyz[(range_m > 1.0) & (range_m <= REAL_RANGE_M)]
    origins = np.broadcast_to(origin, xyz.shape)
    points = SurfacePoints(
        xyz, beam_covariance(xyz, origins, REAL_NOISE_M, 0.05), origins=origins, crs=CRS_OF_SCENES
    )
    out = stream(FIRST_SEED, "free nodes", name).random(len(xyz)) < 0.1
    surface = free_lattice(points.select(~out), STEP_M)
    found = surface.distances(xyz[out])
    spread = np.hypot(found.sigma_m, REAL_NOISE_M)
    field = FieldLattice(FieldLatticeConfig(step_m=STEP_M)).fit(points.select(~out))
    below = np.abs(xyz[out, 2] - field.predict(xyz[out, :2]))
    away = np.abs(found.distance_m)
    return {
        "points": len(xyz),
        "left_out": int(out.sum()),
        "median_m": round(float(np.median(away)), 3),
        "p95_m": round(float(np.quantile(away, 0.95)), 3),
        "within_95": round(float((away <= SIGMAS_95 * spread).mean()), 3),
        "within_95_nearer_0.5_m": round(float((away <= SIGMAS_95 * spread)[away <= 0.5].mean()), 3),
        "beyond_0.5_m": round(float((away > 0.5).mean()), 3),
        "field_median_height_m": round(float(np.nanmedian(below)), 3),
        "field_p95_height_m": round(float(np.nanquantile(below, 0.95)), 3),
    }


def measure() -> None:
    """Judge all sites, and store the table."""
    run, made = Run.begin(measure, RESULT), dict[Site, Score]()
    sites = [
        Site(scene, differs, FIRST_SEED + k)
        for scene in SCENES
        for differs in (False, True)
        for k in range(N_SITES)
    ]
    judge(
        Site("glacier table", differs=False, seed=FIRST_SEED - 1)
    )  # compiles, so that times are those of the work
    for site, score in run_all(
        judge, sites, engine="serial" if N_WORKERS == 1 else "processes", workers=N_WORKERS
    ):
        made[site] = score
        print(*site, json.dumps(row_of([score])), flush=True)
    rows: dict[str, Any] = {}
    for differs in (False, True):
        kind = "differs" if differs else "as assumed"
        for scene in SCENES:
            rows[f"{scene}, {kind}"] = row_of([made[site] for site in sites if site[:2] == (scene, differs)])
        rows[f"all, {kind}"] = row_of([made[site] for site in sites if site.differs == differs])
    rows |= {f"real: {name}": real_row(name) for name in REAL}
    for name, row in rows.items():
        print(name, json.dumps(row))
    run.write({"step_m": STEP_M, "seen_m": SEEN_M, "bars": BARS, "rows": rows})


if __name__ == "__main__":
    measure()
