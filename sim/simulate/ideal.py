"""Ideal fidelity: a perfect sensor that samples the terrain along the route."""

import numpy as np

from sim.config.mission import MissionConfig
from sim.vehicle.exact_motion import exact_drive
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.sensors.aiding import GpsFixes
from survey.data.truth import Truth


def simulate_ideal(terrain: Dem, route: Route, mission: MissionConfig) -> tuple[Recording, Truth]:
    """Return exact positions on the ground every `sensors.sample_step_m` along a route."""
    trajectory, _ = exact_drive(terrain, route, mission.rover.speed_m_s)
    samples = route.sample(mission.sensors.sample_step_m)
    ground = np.column_stack([samples.xy, terrain.at(samples.xy)])
    fixes = GpsFixes(samples.distance_m / mission.rover.speed_m_s, ground)
    recording = Recording(route.crs, ground[0], fixes, vertical_datum=terrain.vertical_datum)
    return recording, Truth(terrain, trajectory)
