"""Closed loop on random sites: plan, upload, drive, telemetry, watch, next swath, upload, until the watch stops the survey.

The rover runs in a process of its own behind its link, a hundred times as fast as real time; which of its fixes arrive when
depends on the machine, so that distances differ by metres between runs. Developed on indices from 1,000 on.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from time import monotonic

import numpy as np

from benchmarks.live.rover_process import RoverKind, rover
from benchmarks.promise_on_real_ground.surveys import map_error_m
from benchmarks.promise_on_real_ground.windows import Site
from benchmarks.report import Row
from live.link import LinkAddress, Vehicle
from live.mission.items import AutopilotMission
from live.mission.transfer import start_mission
from live.mission.vehicle_mission import upload
from live.rover.drive import RoverSettings
from live.watch.log import entered
from live.watch.samples import TelemetryReader, buffered_entries
from live.watch.survey_watch import SurveyWatch
from planners.guarantee.adaptive import AdaptiveConfig, first_swaths
from planners.guarantee.guarantee import guarantee, posterior_of
from planners.guarantee.requirement import MapRequirement
from planners.routes.shortest_paths import FreeGround
from planners.swaths.heading import across_marked_grain
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.interchange.missions import Surroundings
from survey.terrain import random_dem, satellite_copy

SEED = 20_294
_SIDE_M, _CRS, _WEST, _SOUTH = 300.0, "EPSG:32608", 526_000.0, 6_478_000.0
_KINDS = (("squared-exponential", 47.0), ("matern-5/2", 60.0), ("matern-3/2", 100.0))
_LIMIT_M, _ASKED, _NOISE_M, _SHARED_M, _STEP_M = 0.4572, 0.95, 0.1, 0.05, 10.0
_SPEED_M_S, _HASTEN, _PATIENCE_S = 2.0, 100.0, 60.0
_MOST_DRIVE_S = 900.0
_MOST_DISTANCE = 0.85


@dataclass(frozen=True)
class Loop:
    """How a survey ended: stopped by its rule or not, the error of its map [m], distances driven and planned beforehand [m]."""

    stopped: bool
    rmse_m: float
    driven_m: float
    beforehand_m: float


def loop_rows(quick: bool) -> Iterator[Row]:
    """Yield how many stops were right, and what was driven beside the plan beforehand."""
    done = [looped(index) for index in range(1 if quick else 10)]
    stopped = [one for one in done if one.stopped]
    right = float(np.mean([one.rmse_m <= _LIMIT_M for one in stopped])) if stopped else 0.0
    yield Row(f"closed loop, {len(done)} sites: surveys that were stopped", len(stopped), "1")
    yield Row.of("closed loop: share of stops at which the class was true", right, "1", ">=", 0.95)
    yield Row(
        "closed loop: largest RMSE at a stop", max((one.rmse_m for one in stopped), default=np.nan), "m"
    )
    shares = [one.driven_m / one.beforehand_m for one in stopped if np.isfinite(one.beforehand_m)]
    yield Row("closed loop: sites that could be planned beforehand as well", len(shares), "1")
    share = float(np.sum([one.driven_m for one in stopped if np.isfinite(one.beforehand_m)]))
    planned = float(np.sum([one.beforehand_m for one in stopped if np.isfinite(one.beforehand_m)]))
    ratio = share / planned if planned else np.nan
    yield Row.of("closed loop: distance over that of the plan beforehand", ratio, "1", "<=", _MOST_DISTANCE)


def site_of(index: int) -> Site:
    """Return random terrain with a prior of 40 m cells."""
    family, length_m = _KINDS[index % len(_KINDS)]
    bounds = (_WEST, _SOUTH, _WEST + _SIDE_M, _SOUTH + _SIDE_M)
    around = (
        _WEST - 30.0,
        _SOUTH - 30.0,
        _WEST + _SIDE_M + 25.0,
        _SOUTH + _SIDE_M + 25.0,
    )  # 9 × 9 cells of the prior
    terrain = random_dem(
        family, Grid(around, 5.0, _CRS), stream(SEED, "site", index), 10.0, length_scale_m=length_m
    )
    prior = satellite_copy(terrain, rng=stream(SEED, "prior", index), cell_m=40.0, sigma_m=0.5)
    return Site(terrain, SurveyArea.rectangle(bounds, _CRS), prior, _LIMIT_M)


def _wanted() -> MapRequirement:
    return MapRequirement(
        _LIMIT_M,
        _ASKED,
        noise_m=_NOISE_M,
        shared_m=_SHARED_M,
        sample_step_m=_STEP_M,
        prior_sigma_m=0.5,
        n_simulations=24,
    )


def _planned(site: Site, wanted: MapRequirement) -> tuple[SurveyWatch, Route]:
    """Return the watch of a survey, and its first swaths."""
    config = AdaptiveConfig.of(wanted, across_marked_grain(FreeGround(site.area.free), site.prior))
    route = first_swaths(site.area, posterior_of(site.area, site.prior, wanted), config)
    return SurveyWatch(site.area, config, list(route.legs), every_m=1e9), route


def looped(index: int) -> Loop:
    """Survey one site until the watch stops it; judge the map against the truth."""
    site = site_of(index)
    wanted = _wanted()
    watch, route = _planned(site, wanted)
    settings = RoverSettings(_SPEED_M_S, range_m=1e6, sigma_vertical_m=_NOISE_M, seed=SEED + index)
    shared_m = _SHARED_M * stream(SEED, "shared", index).standard_normal()
    lifted = Dem(site.terrain.elevation + shared_m, site.terrain.transform, site.terrain.crs)
    with rover(RoverKind(settings=settings, terrain=lifted, hasten=_HASTEN)) as one:
        while not watch.is_stopped:
            mission = AutopilotMission.of_route(route, Surroundings(site.area))
            upload(mission, one.address, patience_s=_PATIENCE_S)
            _follow(one.address, watch)
            advice = watch.advice
            assert advice is not None
            if advice.legs:
                watch.send(advice.legs)
                route = Route(advice.legs, site.area.crs, "adaptive")
    return _judged(site, wanted, watch)


def _follow(address: LinkAddress, watch: SurveyWatch) -> None:
    """Start the mission, and give the telemetry to the watch until all legs are driven or the survey is stopped."""
    until = monotonic() + _MOST_DRIVE_S
    with Vehicle.connected(address, _PATIENCE_S) as vehicle:
        start_mission(vehicle)
        with closing(buffered_entries(vehicle, TelemetryReader(watch.area.crs))) as entries:
            for entry in entries:
                entered(watch, entry)
                if watch.is_stopped or watch.progress.n_driven == len(watch.legs):
                    return
                if monotonic() > until:
                    raise RuntimeError(f"leg {watch.progress.n_driven + 1} was not driven in time.")


def _judged(site: Site, wanted: MapRequirement, watch: SurveyWatch) -> Loop:
    """Return the error of the map at the end, and the distances."""
    xyz, advice = watch.xyz, watch.advice
    assert advice is not None
    planned = guarantee(site.area, site.prior, wanted)
    error_m = map_error_m(site, xyz[:, :2], xyz[:, 2], _NOISE_M)
    beforehand_m = planned.route.length_m if planned.holds else float("inf")
    return Loop(advice.is_met, error_m, watch.progress.driven_m, beforehand_m)
