"""Judge maps that images extend beyond the range of a scanner: ``python -m benchmarks.images_beyond_scans``.

A rover with a scanner of 15 m range and a camera on one mast drives 30 m over simulated snow, with a coarse prior. Path and landmarks are estimated from
the recording; nothing of the truth reaches an estimator. The map of scans, landmarks and prior alone is compared with the one that heights
from images extend, on ground beyond the scans that three of 25 true poses see. In the other rows simulator and estimator differ: a focal length that
is stated 0.3 % too long; a low sun and exposures that jump; snow of half the contrast; a receiver that errs by metres with a memory; and snow banks that
were removed after the images and before the scans. No setting was chosen on these seeds. No recording of real images and LiDAR of one place is
at hand, so there is no row of real data. The table goes to ``results/benchmarks/images_beyond_scans.json``; it takes about a quarter of an hour of CPU.
"""

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import vision_slam
from benchmarks.writer import TABLES, Run
from sim.config.mission import MissionConfig
from sim.config.sensors import GpsConfig, InstrumentsConfig, LidarConfig
from sim.config.world import AppearanceConfig, ImagingConfig, SatelliteConfig, SceneryConfig
from sim.instruments.lidar import scans_along
from sim.simulate.simulation import mission_of_drive
from sim.simulate.vision import simulate_vision
from sim.world.fine_terrain import band_limited_field
from sim.world.site import erroneous_copy
from survey import Dem, Grid, Leg, Recording, Route, Truth
from survey.core import BoolArray, FloatArray
from survey.core.executors import run_all
from survey.core.streams import stream
from survey.data.camera import Camera
from survey.data.sensors.lidar import LidarScans
from vision_slam.drive_estimate import Localization
from vision_slam.extended_map import ExtendedMap, extend_map
from vision_slam.scan_agreement import MOVED

RESULT = TABLES / "images_beyond_scans.json"
SIDE_M, LENGTH_M, REACH_M, FIRST_SEED, N_WORKERS = 100.0, 30.0, 45.0, 9_300, 2
LIDAR = LidarConfig(
    beams=32, columns=360, elevation_deg=(-35.0, 3.0), range_m=15.0, height_m=1.8, rate_hz=0.5
)
RTK, SBAS = GpsConfig(profile="rtk"), GpsConfig(profile="sbas")
SCENERY = SceneryConfig(crevasses_per_ha=0.0, pools_per_ha=0.0, channels_per_ha=0.0, dirt_cones_per_ha=0.0)
LOW_SUN = AppearanceConfig(sun_elevation_deg=8.0)
WEAK = AppearanceConfig(contrast=0.5, patches=0.5, debris=0.5)
BANKS_M = ((56.0, 57.5), (62.0, 43.0))
BANK_HEIGHT_M, BANK_RADIUS_M = 0.7, 1.4
FOCAL_RATIO = 1.003
MAPPED_M = 10.0  # from the edge of the site
PLAIN, LENS, MOVED_ROW, LIGHT, CONTRAST, POSES = (
    "as assumed", "focal length 0.3 % off", "snow banks removed", "low sun, exposure jumps", "half the contrast", "metres of GPS error",
)  # fmt: skip
N_OF = {PLAIN: 3, LENS: 1, MOVED_ROW: 2, LIGHT: 1, CONTRAST: 1, POSES: 1}


@dataclass(frozen=True)
class Drive:
    """Drive over one site, and the rows that are judged on it."""

    rows: tuple[str, ...]
    seed: int


class Figures(NamedTuple):
    """Errors of both maps on ground beyond scans that images see (N,), their standard deviations [m], and what was found.

    `hidden_inside`: whether each node beyond the scans that no image sees lies within its 95 % interval. `n_banks`: banks that were removed, and
    `n_found`: those that are found; `n_false`: places that are said to have moved, and have not.
    """

    alone_m: FloatArray
    error_m: FloatArray
    sigma_m: FloatArray
    hidden_inside: BoolArray
    n_heights: int
    strip_coverage: float
    n_banks: int
    n_found: int
    n_false: int
    cpu_s: float


def drives() -> list[Drive]:
    """Return the drives: the first ones are judged in several rows."""
    plain = [
        Drive(tuple(row for row in (PLAIN, LENS, MOVED_ROW) if k < N_OF[row]), FIRST_SEED + k)
        for k in range(N_OF[PLAIN])
    ]
    others = [(row, k) for row in (LIGHT, CONTRAST, POSES) for k in range(N_OF[row])]
    return plain + [Drive((row,), FIRST_SEED + 100 + k) for k, (row, _) in enumerate(others)]


def banks(xy: FloatArray) -> FloatArray:
    """Return the height of the snow banks at places (N, 2) [m]."""
    away = np.array([np.hypot(*(xy - bank).T) for bank in BANKS_M])
    return BANK_HEIGHT_M * np.exp(-0.5 * (away / BANK_RADIUS_M) ** 2).sum(axis=0)


def site(seed: int) -> Dem:
    """Draw rolling snow with two banks."""
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 1.0, "EPSG:32608")
    relief = 1.3 * band_limited_field(grid.shape, 1.0, (30.0, 90.0), 1.5, stream(seed, "images beyond scans"))
    return Dem.on(grid, relief.astype(np.float64) + banks(grid.xy).reshape(grid.shape))


def mission(drive: Drive) -> MissionConfig:
    """Return the settings of a drive."""
    row = drive.rows[0]
    imaging = ImagingConfig(height_m=1.8, gain_step_ev=0.5 if row == LIGHT else 0.0)
    looks = {LIGHT: LOW_SUN, CONTRAST: WEAK}
    gps = SBAS if row == POSES else RTK
    return mission_of_drive(
        seed=drive.seed,
        fidelity="vision",
        imaging=imaging,
        scenery=SCENERY,
        appearance=looks.get(row, AppearanceConfig()),
        instruments=InstrumentsConfig(gps=gps),
    )


def judge(drive: Drive) -> dict[str, Figures]:
    """Simulate a drive, localize it, and judge its rows."""
    began, settings, terrain = time.process_time(), mission(drive), site(drive.seed)
    middle = 0.5 * SIDE_M
    line = np.array([[middle - 0.5 * LENGTH_M, middle], [middle + 0.5 * LENGTH_M, middle]])
    route = Route((Leg("swath", line),), terrain.crs, "line")
    with tempfile.TemporaryDirectory() as folder:
        driven = simulate_vision(terrain, route, settings, Path(folder) / "recording")
        recording, truth = driven.recording, driven.truth
        assert recording.camera is not None
        errors = stream(drive.seed, "prior", "errors")
        prior = erroneous_copy(
            truth.dem.block_mean(1.0), SatelliteConfig(cell_m=10.0), stream(drive.seed, "prior"), errors
        )
        scans = scans_along(truth.trajectory, truth.dem, LIDAR, drive.seed)
        found = vision_slam.localize(recording, settings.assumed)
        made = {}
        for row in drive.rows:
            given, used, path = recording, scans, found
            if row == LENS:
                given = replace(recording, camera=_other_focal_length(recording.camera))
                path = vision_slam.localize(given, settings.assumed)
            if row == MOVED_ROW:
                used = _scans_without_banks(truth, drive.seed)
            made[row] = _figures(replace(given, lidar=used), path, prior, truth, row)._replace(
                cpu_s=time.process_time() - began
            )
            began = time.process_time()
    return made


def _other_focal_length(camera: Camera) -> Camera:
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= FOCAL_RATIO
    return replace(camera, matrix=matrix)


def _scans_without_banks(truth: Truth, seed: int) -> LidarScans:
    """Return the scans of the same path after the banks were removed."""
    after = truth.dem.elevation - banks(truth.dem.xy).reshape(truth.dem.shape)
    return scans_along(truth.trajectory, Dem.on(truth.dem.grid(), after), LIDAR, seed)


def _figures(recording: Recording, found: Localization, prior: Dem, truth: Truth, row: str) -> Figures:
    """Extend the map of a drive, and judge it."""
    grid = Grid((MAPPED_M, MAPPED_M, SIDE_M - MAPPED_M, SIDE_M - MAPPED_M), 1.0, truth.dem.crs)
    assert recording.camera is not None
    extended = extend_map(recording, found.trajectory, found.points, grid, prior)
    nodes = extended.reconstruction.mean.xy
    real, beyond = truth.dem.at(nodes), ~extended.is_scanned.ravel()
    seen = seen_by_images(nodes, truth, recording.camera)
    alone, made = (
        one.mean.elevation.ravel() - real for one in (extended.scans_alone, extended.reconstruction)
    )
    sigma = extended.reconstruction.std.elevation.ravel()
    judged, hidden = beyond & seen, beyond & ~seen
    n_banks = len(BANKS_M) if row == MOVED_ROW else 0
    n_found, n_false = _moved_places(extended, n_banks)
    inside = np.abs(made) <= 1.96 * sigma
    return Figures(
        alone[judged], made[judged], sigma[judged], inside[hidden], len(extended.heights), extended.errors.coverage,
        n_banks, n_found, n_false, 0.0,
    )  # fmt: skip


def _moved_places(extended: ExtendedMap, n_banks: int) -> tuple[int, int]:
    """Return how many removed banks are named as moved ground, and how many places are that have not moved."""
    named = np.array([one.xy for one in extended.contradictions if one.reason == MOVED]).reshape(-1, 2)
    removed = np.array(BANKS_M[:n_banks]).reshape(-1, 2)
    away = np.linalg.norm(named[:, None] - removed[None], axis=2)
    near = 3.0 * BANK_RADIUS_M
    return int((away.min(axis=0, initial=np.inf) <= near).sum()), int(
        (away.min(axis=1, initial=np.inf) > near).sum()
    )


def seen_by_images(xy: FloatArray, truth: Truth, camera: Camera) -> BoolArray:
    """Return which places (N, 2) at least three of 25 true poses see within reach."""
    dem, path = truth.dem, truth.trajectory
    xyz, n_seen = np.column_stack([xy, dem.at(xy) + 0.05]), np.zeros(len(xy), dtype=np.int64)
    for pose in np.linspace(0, len(path) - 1, 25).astype(int).tolist():
        turn = Rotation.from_quat(path.quaternion[pose]).as_matrix()
        place, looks = (
            path.position[pose] + turn @ camera.T_body_camera[:3, 3],
            turn @ camera.T_body_camera[:3, :3],
        )
        offset = xyz - place
        pixel = camera.project(offset @ looks)
        with np.errstate(invalid="ignore"):
            inside = (pixel > 8.0).all(axis=1) & (pixel < [camera.width - 8.0, camera.height - 8.0]).all(
                axis=1
            )
        seen = np.flatnonzero(inside & (np.linalg.norm(offset, axis=1) < REACH_M))
        clear = np.ones(len(seen), dtype=np.bool_)
        for share in np.linspace(0.02, 0.985, 120):
            on = place + share * offset[seen]
            clear &= ~(dem.at(on[:, :2]) > on[:, 2])
        n_seen[seen[clear]] += 1
    return n_seen >= 3


def row_of(judged: Sequence[Figures]) -> dict[str, Any]:
    """Return the scores of several sites."""
    alone, error = (
        [_rms(one) for one in column]
        for column in zip(*((f.alone_m, f.error_m) for f in judged), strict=True)
    )
    ratio = np.array(error) / np.array(alone)
    inside = [float((np.abs(f.error_m) <= 1.96 * f.sigma_m).mean()) for f in judged]
    nodes = np.concatenate([np.abs(f.error_m) for f in judged])
    without = np.concatenate([np.abs(f.alone_m) for f in judged])
    strip = [f.strip_coverage for f in judged if np.isfinite(f.strip_coverage)]
    return {
        "sites": len(judged),
        "nodes": len(nodes),
        "heights_from_images": int(sum(f.n_heights for f in judged)),
        "rmse_without_images_m": round(_rms(without), 3),
        "rmse_m": round(_rms(nodes), 3),
        "rmse_ratio": round(_rms(nodes) / _rms(without), 3),
        "rmse_ratio_worst_site": round(float(ratio.max()), 3),
        "error_p95_m": round(float(np.percentile(nodes, 95)), 3),
        "error_p95_without_images_m": round(float(np.percentile(without, 95)), 3),
        "error_worst_m": round(float(nodes.max()), 3),
        "error_worst_without_images_m": round(float(without.max()), 3),
        "coverage_95": round(
            float(np.concatenate([np.abs(f.error_m) <= 1.96 * f.sigma_m for f in judged]).mean()), 3
        ),
        "coverage_95_least_site": round(min(inside), 3),
        "coverage_95_hidden_ground": round(
            float(np.concatenate([f.hidden_inside for f in judged]).mean()), 3
        ),
        "coverage_95_held_out_heights": round(float(np.mean(strip)), 3) if strip else None,
        "banks_removed": sum(f.n_banks for f in judged),
        "banks_found": sum(f.n_found for f in judged),
        "places_wrongly_said_to_have_moved": sum(f.n_false for f in judged),
        "cpu_s_per_site": round(float(np.mean([f.cpu_s for f in judged])), 1),
    }


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def measure() -> None:
    """Judge all drives, and store the table."""
    run, made = Run.begin(measure, RESULT), dict[Drive, dict[str, Figures]]()
    for drive, judged in run_all(judge, drives(), engine="processes", workers=N_WORKERS):
        made[drive] = judged
        for row, figures in judged.items():
            print(drive.seed, json.dumps({row: row_of([figures])}), flush=True)
    table = {row: row_of([made[drive][row] for drive in drives() if row in drive.rows]) for row in N_OF}
    for name, row in table.items():
        print(name, json.dumps(row))
    run.write({"side_m": SIDE_M, "scanner_range_m": LIDAR.range_m, "reach_m": REACH_M, "rows": table})


if __name__ == "__main__":
    measure()
