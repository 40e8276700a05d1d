"""Surveys of one site on moving ice and on still ice, mapped with and without the motion of the ice.

A survey on moving ice is that on still ice with the same errors: what is measured relative to the ice stays as it is, and
fixes, barometer and stakes are carried by the flow. Differences between the two are then those of the motion alone.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.moving_ice.cases import SIDE_M, Case, mission_of
from benchmarks.moving_ice.chance import drawn_coverages
from planners import plan
from sim.config.mission import MissionConfig
from sim.simulate.simulation import simulate_statistical
from sim.world.moving_ice import MovingIce, epoch_of, moving_ice
from sim.world.site import build_world
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.ice_motion import IceMotion
from survey.data.recording import Recording
from survey.data.route import Route
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import JointMap
from survey.reconstruction.motion.refinement import refined_motion
from vision_slam import localize, localize_on_ice
from vision_slam.drive_estimate import Localization

_Z95 = 1.959964
# Every so many nodes stand for the map where errors are drawn from its covariance.
_EVERY = 7


@dataclass(frozen=True)
class Outcome:
    """Error and coverage of one map, and of the motion that was estimated with it."""

    rmse_m: float
    coverage: float
    claimed_m: float
    chance: tuple[float, ...]
    velocity_scores: tuple[float, ...] = ()
    lowering_scores: tuple[float, ...] = ()
    velocity_sigma: float = 0.0
    lowering_sigma: float = 0.0


@dataclass(frozen=True)
class Drive:
    """A recording with what is judged against: the terrain of the epoch and the flow."""

    mission: MissionConfig
    recording: Recording
    terrain: Dem
    ice: MovingIce
    nodes: Grid
    route: Route
    start_terrain: Dem

    @property
    def epoch_s(self) -> float:
        """Epoch of the map [s]."""
        return epoch_of(self.recording, self.mission)

    def prior(self) -> IceMotion:
        """Return the prior of the motion."""
        assert self.mission.ice is not None
        xmin, ymin, xmax, ymax = self.nodes.bounds
        return self.mission.ice.assumed.prior(self.epoch_s, (0.5 * (xmin + xmax), 0.5 * (ymin + ymax)))


def drive_of(case: Case) -> Drive:
    """Simulate the survey of a case."""
    mission = mission_of(case)
    at_rest = mission_of(replace(case, velocity=0.0))
    world = build_world(mission)
    route = plan(world.area, world.prior, mission.planner, rover=mission.rover)
    recording, _ = simulate_statistical(world.terrain, route, at_rest)
    recording = with_start_error(recording, mission)
    ice = moving_ice(mission, world.terrain)
    assert ice is not None
    carried = recording_on(ice, recording)
    terrain = ice.terrain_at(world.terrain, epoch_of(carried, mission))
    nodes = Grid.over(world.area.bounds, SIDE_M / 50.0, world.area.crs)
    return Drive(mission, carried, terrain, ice, nodes, route, world.terrain)


def with_start_error(recording: Recording, mission: MissionConfig) -> Recording:
    """Return a recording whose start was surveyed with the error that is assumed of it."""
    error = mission.assumed.start_sigma_m * stream(mission.seed, "start").standard_normal(3)
    return replace(recording, start=recording.start + error)


def recording_on(ice: MovingIce, still: Recording) -> Recording:
    """Return a recording on still ice as that on ice that carries rover and stakes; the base station stands on rock."""
    gps, barometer, surveys = still.gps, still.barometer, still.stake_surveys
    assert barometer is not None
    places = np.column_stack(
        [np.interp(barometer.time_s, gps.time_s, axis) for axis in gps.position[:, :2].T]
    )
    risen = ice.displacement(places, barometer.time_s)[:, 2]
    if surveys is not None:
        moved = ice.displacement(surveys.position[:, :2], surveys.time_s)
        surveys = replace(surveys, position=surveys.position + moved)
    return replace(
        still,
        gps=replace(gps, position=gps.position + ice.displacement(gps.position[:, :2], gps.time_s)),
        barometer=replace(barometer, height_m=barometer.height_m + risen),
        stake_surveys=surveys,
    )


def outcomes_of(case: Case) -> dict[str, Any]:
    """Map the survey of a case with its motion, and by the static estimate."""
    drive = drive_of(case)
    found = localize_on_ice(drive.recording, drive.prior(), drive.mission.assumed)
    moving = _judged(drive, found, case.kernel)
    static = _judged(drive, localize(drive.recording, drive.mission.assumed), case.kernel)
    return {"moving": asdict(moving), "static": asdict(static)}


def _judged(drive: Drive, found: Localization, kernel: GaussianProcessConfig) -> Outcome:
    """Judge map and motion of one localization."""
    mapped = map_of(drive, found, kernel)
    result = mapped.reconstruction
    error = result.mean.elevation - drive.terrain.at(drive.nodes.xy).reshape(drive.nodes.shape)
    std = result.std.elevation
    outcome = Outcome(
        float(np.sqrt(np.mean(error**2))),
        float(np.mean(np.abs(error) <= _Z95 * std)),
        float(np.sqrt(np.mean(std**2))),
        tuple(drawn_coverages(mapped.solution, drive.nodes.xy[::_EVERY], drive.mission.seed)),
    )
    if found.ice_motion is None:
        return outcome
    return _with_motion(outcome, drive, refined_motion(found.ice_motion, mapped.solution))


def map_of(drive: Drive, found: Localization, kernel: GaussianProcessConfig) -> JointMap:
    """Return the joint map of a localization, without a prior."""
    return joint_terrain(found, kernel).map(found.points, drive.nodes)


def joint_terrain(found: Localization, kernel: GaussianProcessConfig) -> JointTerrain:
    """Return the joint estimate of terrain and path, without a prior."""
    assert found.trajectory.error is not None
    return JointTerrain(found.trajectory.error, config=kernel)


def _with_motion(outcome: Outcome, drive: Drive, motion: IceMotion) -> Outcome:
    """Add errors of velocity and lowering in standard deviations, in the middle of the site."""
    places = middle_of(drive.nodes)
    scores = (motion.rates(places) - real_rates(drive, places)) / motion.rates_sigma(places)
    sigma = motion.rates_sigma(places)[0]
    return replace(
        outcome,
        velocity_scores=tuple(scores[0, :2].tolist()),
        lowering_scores=(float(scores[0, 2]),),
        velocity_sigma=float(sigma[:2].max()),
        lowering_sigma=float(sigma[2]),
    )


def middle_of(nodes: Grid) -> FloatArray:
    """Return the middle of the site."""
    xmin, ymin, xmax, ymax = nodes.bounds
    return np.array([[0.5 * (xmin + xmax), 0.5 * (ymin + ymax)]])


def real_rates(drive: Drive, xy: FloatArray) -> FloatArray:
    """Return the real mean rates (N, 3) over the drive [m/day]."""
    ends = drive.recording.gps.time_s[[0, -1]]
    moved = [drive.ice.displacement(xy, np.full(len(xy), end)) for end in ends]
    rates: FloatArray = (moved[1] - moved[0]) / ((ends[1] - ends[0]) / 86400.0)
    return rates
