"""Judge drives whose route is changed around hazards that the scanner shows: ``python -m benchmarks.hazards_ahead``.

How often the rover reaches lethal ground, on the planned route and on the one that is changed while it is driven; its stops, its length over the
planned one, and the share of the swaths that are left out. The terrain is simulated ice with crevasses, channels, cones and pools that no
prior shows, and 1 m models of real ground. In the rows that differ the ranges are three times noisier than stated, attitudes err twice as
much, more snow is blown about, and debris with boulders takes the place of snow. In the row without foresight the
route is changed only where the rover has to stop. Lethal ground is found from the exact terrain. No setting was chosen on these
seeds. Other windows of the same models of real ground, and other seeds, were driven before: the accepted probability was halved and ways back
were mended after them. A rover that gives up early reaches no lethal ground: read entries with the share of the swaths that is left out.
The table goes to ``results/benchmarks/hazards_ahead.json``; it takes about three quarters of an hour of CPU.
"""

import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS

from benchmarks.writer import TABLES, Run
from planners.look_ahead import LookAheadSettings
from planners.routes.detours import densified
from sim.config.sensors import LidarConfig
from sim.config.world import SceneryConfig
from sim.simulate.look_ahead_drive import HazardDrive, LethalGround, PoseErrors, drive_with_look_ahead
from sim.world.fine_terrain import band_limited_field, fine_terrain
from survey import Dem, Grid, Leg, Route, SurveyArea
from survey.core.executors import run_all
from survey.core.streams import stream

RESULT = TABLES / "hazards_ahead.json"
DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[2] / "shared" / "data"))
SIDE_M, SPACING_M, MARGIN_M = 100.0, 25.0, 3.0
N_SITES, N_REAL, N_WITHOUT, FIRST_SEED = 10, 2, 3, 8_000
N_WORKERS = 2
CRS_OF_SITES = CRS("EPSG:32608")
LIDAR = LidarConfig(beams=32, columns=360, elevation_deg=(-35.0, 3.0), range_m=30.0)
NOISY = LIDAR.model_copy(update={"range_sigma_m": 0.09, "spray_share": 0.02, "divergence_deg": 0.1})
SETTINGS = LookAheadSettings()
REACTIVE = replace(SETTINGS, horizon_m=SETTINGS.brake_m)
_PLAIN = SceneryConfig(
    dune_sd_m=0.0, sastrugi_sd_m=0.02, hummock_sd_m=0.0, crevasses_per_ha=0.0, pools_per_ha=0.0, channels_per_ha=0.0,
    dirt_cones_per_ha=0.0,
)  # fmt: skip
_HARD = SceneryConfig(
    dune_sd_m=0.07, crevasses_per_ha=2.0, bridged_share=0.0, dirt_cones_per_ha=5.0, pools_per_ha=1.0, channels_per_ha=1.0
)  # fmt: skip
REAL = {
    "dem_slovenia_lidar_1m": "TM1_564_146.tif",
    "dem_subarctic_alpine_granger_1m": "dem_1m.tif",
    "dem_debrisflow_kelowna_1m": "dem_1m.tif",
}
_HARD_SHARE = (0.002, 0.08)
"""Lethal shares of the windows of real ground that are driven."""


def simulated_ice(seed: int, *, differs: bool) -> Dem:
    """Draw ice with hazards: snow, or debris with boulders."""
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 2.0, CRS_OF_SITES)
    relief = 0.9 * band_limited_field(grid.shape, 2.0, (40.0, 120.0), 1.5, stream(seed, "hazards ahead"))
    debris = {"surface": "debris", "boulders_per_ha": 8.0, "crevasses_per_ha": 1.0} if differs else {}
    scenery = _HARD.model_copy(update=debris)
    return fine_terrain(Dem.on(grid, relief.astype(np.float64)), scenery, seed).dem


def real_windows(folder: str) -> Iterator[Dem]:
    """Yield `N_REAL` windows of a terrain model, refined to 0.25 m, of which a little is lethal."""
    model = Dem.read(DATA / folder / REAL[folder])
    n, found = round(SIDE_M / model.step_m), 0
    rng = stream(FIRST_SEED, "hazards ahead", folder)
    for _ in range(400):
        row, column = (int(rng.integers(0, size - n)) for size in model.shape)
        z = model.elevation[row : row + n + 1, column : column + n + 1]
        if z.shape != (n + 1, n + 1) or not np.isfinite(z).all():
            continue
        grid = Grid((0.0, 0.0, n * model.step_m, n * model.step_m), model.step_m, CRS_OF_SITES)
        terrain = fine_terrain(Dem.on(grid, z), _PLAIN, FIRST_SEED + found).dem
        start = np.array([[MARGIN_M + 5.0, MARGIN_M + 5.0]])
        lethal = LethalGround(terrain, SETTINGS.limit)
        if _HARD_SHARE[0] <= lethal.share <= _HARD_SHARE[1] and not lethal.is_at(start).any():
            found += 1
            yield terrain
            if found == N_REAL:
                return


def lawnmower() -> tuple[Route, SurveyArea]:
    """Return parallel swaths over the site, and the ground that may be driven."""
    area = SurveyArea.rectangle((MARGIN_M, MARGIN_M, SIDE_M - MARGIN_M, SIDE_M - MARGIN_M), CRS_OF_SITES)
    ends = (MARGIN_M + 5.0, SIDE_M - MARGIN_M - 5.0)
    lines = np.arange(ends[0], ends[1] + 1.0, SPACING_M)
    xy = np.array([[x, y] for k, y in enumerate(lines) for x in ends[:: 1 - 2 * (k % 2)]])
    legs = [Leg("transit" if k % 2 else "swath", xy[k : k + 2]) for k in range(len(xy) - 1)]
    return Route(tuple(legs), area.crs, "lawnmower", SPACING_M), area


@dataclass(frozen=True)
class Site:
    """One site of a row: its seed, or the number of its window of real ground."""

    row: str
    number: int


class Drive(NamedTuple):
    """Scores of a drive, entries of the planned route, length of its swaths [m], and CPU time [s]."""

    drive: HazardDrive
    planned_entries: int
    swaths_m: float
    cpu_s: float


WRONG = PoseErrors(slow_m=1.0, walk_m=0.01, tilt_deg=0.3, yaw_deg=0.4, steering_m=0.2)
SNOW, DEBRIS, WITHOUT = "snow, as assumed", "debris, differs", "snow, without foresight"


def sites() -> list[Site]:
    """Return the sites of all rows."""
    n_of = {SNOW: N_SITES, DEBRIS: N_SITES, WITHOUT: N_WITHOUT, **dict.fromkeys(REAL, N_REAL)}
    return [Site(row, number) for row, n in n_of.items() for number in range(n)]


def drive(site: Site) -> Drive | None:
    """Drive the swaths over one site; what is stated to the rover is `LIDAR`. None where a model has too few windows."""
    began, seed = time.process_time(), FIRST_SEED + site.number
    lidar, errors = (NOISY, WRONG) if site.row == DEBRIS else (LIDAR, PoseErrors())
    settings = REACTIVE if site.row == WITHOUT else SETTINGS
    if site.row in REAL:
        windows = list(real_windows(site.row))
        if site.number >= len(windows):
            return None
        terrain = windows[site.number]
    else:
        terrain = simulated_ice(seed, differs=site.row == DEBRIS)
    route, area = lawnmower()
    driven = drive_with_look_ahead(
        terrain, route, area, lidar, stated=LIDAR, settings=settings, errors=errors, seed=seed
    )
    planned = LethalGround(terrain, settings.limit).entries(densified(route.path(), 0.1))
    swaths_m = sum(leg.length_m for leg in route.legs if leg.kind == "swath")
    return Drive(driven._replace(xy=driven.xy[:1]), planned, swaths_m, time.process_time() - began)


def row_of(drives: Sequence[Drive]) -> dict[str, Any]:
    """Return the scores of drives over several sites."""
    over = np.array([one.drive.driven_m / one.drive.planned_m for one in drives])
    skipped = np.array([one.drive.skipped_m / one.swaths_m for one in drives])
    km = sum(one.drive.driven_m for one in drives) / 1e3
    return {
        "sites": len(drives),
        "planned_entries": sum(one.planned_entries for one in drives),
        "entries": sum(one.drive.n_entries for one in drives),
        "sites_with_entries": sum(one.drive.n_entries > 0 for one in drives),
        "distance_over_plan": round(float(over.mean()), 3),
        "distance_over_plan_worst": round(float(over.max()), 3),
        "swaths_left_out": round(float(skipped.mean()), 3),
        "swaths_left_out_worst": round(float(skipped.max()), 3),
        "stops_per_km": round(sum(one.drive.n_stops for one in drives) / km, 2),
        "changes_per_km": round(sum(one.drive.n_detours for one in drives) / km, 1),
        "cpu_s_per_site": round(float(np.mean([one.cpu_s for one in drives])), 1),
    }


def measure() -> None:
    """Drive all sites, and store the table."""
    run, made = Run.begin(measure, RESULT), dict[Site, Drive]()
    for site, driven in run_all(drive, sites(), engine="processes", workers=N_WORKERS):
        if driven is not None:
            made[site] = driven
            print(site, driven.planned_entries, json.dumps(driven.drive[1:]), flush=True)
    rows: dict[str, list[Drive]] = {}
    for site in sites():  # the same sums in whatever order they end
        if site in made:
            rows.setdefault(site.row, []).append(made[site])
    table = {name: row_of(drives) for name, drives in rows.items()}
    for name, row in table.items():
        print(name, json.dumps(row))
    run.write(
        {"side_m": SIDE_M, "spacing_m": SPACING_M, "limit_deg": SETTINGS.limit.slope_deg, "rows": table}
    )


if __name__ == "__main__":
    measure()
