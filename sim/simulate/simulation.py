"""Simulation of a drive along a route: from terrain and route to what the rover senses."""

from typing import Literal

from planners import LawnmowerConfig
from sim.config.mission import AidsConfig, MissionConfig, RoverConfig, SensorConfig
from sim.config.terrain import SampleTerrain
from sim.simulate.ideal import simulate_ideal
from sim.simulate.statistical import simulate_statistical
from survey.core.arguments import check_types
from survey.core.crs.agreement import same_crs
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.truth import Truth


@check_types
def simulate(
    terrain: Dem,
    route: Route,
    *,
    seed: int = 0,
    fidelity: Literal["ideal", "statistical"] = "statistical",
    rover: RoverConfig | None = None,
    sensors: SensorConfig | None = None,
    aids: AidsConfig | None = None,
) -> tuple[Recording, Truth]:
    """Simulate a drive along a route over real terrain.

    Parameters
    ----------
    terrain : Dem
        Terrain that the rover drives on; it holds the whole route.
    route : Route
        Route of one rover, in the CRS of the terrain.
    seed : int
        All random errors follow from it.
    fidelity : {"statistical", "ideal"}
        Sensors with random errors, or one perfect sensor.
    rover : RoverConfig, optional
        Speed and the heights of antenna and camera.
    sensors : SensorConfig, optional
        Standard deviations of the sensors' errors.
    aids : AidsConfig, optional
        Aiding sensors: barometer, stakes, base station …

    Returns
    -------
    recording : Recording
        What the rover sensed; the input of `localize`.
    truth : Truth
        The terrain and the path that was driven, for scoring.

    Raises
    ------
    InputError
        The route leaves the terrain, or is in another CRS.

    Notes
    -----
    No images are rendered; a mission of fidelity ``vision`` does that (`run_mission`).

    Examples
    --------
    >>> import numpy as np
    >>> from survey.data.grid import Grid
    >>> from survey.data.route import Leg
    >>> grid = Grid((0.0, 0.0, 60.0, 60.0), 5.0)
    >>> line = Route((Leg("swath", [[10.0, 30.0], [50.0, 30.0]]),), grid.crs, "line")
    >>> recording, truth = simulate(Dem.on(grid, np.zeros(grid.shape)), line)
    >>> len(recording.gps), round(truth.trajectory.length_m)
    (41, 40)
    """
    same_crs(terrain.crs, route.crs, "the terrain and the route")
    mission = MissionConfig(
        schema_version=1,
        name="drive",
        seed=seed,
        fidelity=fidelity,
        terrain=SampleTerrain(source="srtm-sample"),  # not read: terrain and route are given
        planner=LawnmowerConfig(swaths=1),
        rover=rover or RoverConfig(),
        sensors=sensors or SensorConfig(),
        aids=aids or AidsConfig(),
    )
    return (simulate_ideal if fidelity == "ideal" else simulate_statistical)(terrain, route, mission)
