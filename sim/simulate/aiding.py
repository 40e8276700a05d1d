"""Aiding of a survey beyond its sensors: a return to the start, and a start that is not surveyed."""

from dataclasses import replace

import numpy as np

from planners.ground.transit import FreeGround
from sim.config.mission import MissionConfig
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.legs import Leg
from survey.data.recording import Recording
from survey.data.route import Route


def with_way_home(route: Route, area: SurveyArea) -> Route:
    """Append the shortest path on free ground from the end of a route back to its start.

    Raises
    ------
    InputError
        No path joins them, or the route is that of several rovers.
    """
    if route.n_rovers > 1:
        raise InputError("aids.way_home is for one rover; leave it out, or set fleet.rovers = 1.")
    start, end = route.legs[0].xy[0], route.legs[-1].xy[-1]
    way = FreeGround(area.free).way(end, start)
    return replace(route, legs=(*route.legs, Leg("transit", way)))


def with_unknown_start(recording: Recording, mission: MissionConfig) -> Recording:
    """Replace the surveyed start by the first fix, and turn the odometry by a random heading error."""
    turn_rad = (
        np.radians(mission.aids.heading_sigma_deg) * stream(mission.seed, "aids", "heading").standard_normal()
    )
    start = recording.gps.position[0] - [0.0, 0.0, recording.antenna_height_m]
    odometry = recording.odometry
    if odometry is not None:
        odometry = replace(odometry, attitude_rad=odometry.attitude_rad + [0.0, 0.0, turn_rad])
    return replace(recording, start=start, odometry=odometry)
