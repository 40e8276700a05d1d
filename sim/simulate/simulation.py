"""Simulation of a drive along a route: from terrain and route to what the rover senses."""

import logging
from pathlib import Path
from typing import Literal

from planners import LawnmowerConfig
from sim.config.mission import AidsConfig, MissionConfig, RoverConfig, SensorConfig
from sim.config.sensors import InstrumentsConfig
from sim.config.terrain import SampleTerrain
from sim.simulate.ideal import simulate_ideal
from sim.simulate.statistical import simulate_statistical
from survey.core.arguments import check_types
from survey.core.crs.agreement import same_crs
from survey.core.errors import ConfigError
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.truth import Truth

logger = logging.getLogger(__name__)


@check_types
def simulate(
    terrain: Dem,
    route: Route,
    *,
    seed: int = 0,
    fidelity: Literal["ideal", "statistical", "vision"] = "statistical",
    rover: RoverConfig | None = None,
    sensors: SensorConfig | None = None,
    aids: AidsConfig | None = None,
    instruments: InstrumentsConfig | None = None,
    folder: str | Path | None = None,
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
    fidelity : {"statistical", "ideal", "vision"}
        Sensors with random errors, one perfect sensor, or physics with rendered images.
    rover : RoverConfig, optional
        Speed and the heights of antenna and camera.
    sensors : SensorConfig, optional
        Standard deviations of the sensors' errors; not with ``"vision"``.
    aids : AidsConfig, optional
        Aiding sensors: barometer, stakes, base station …; not with ``"vision"``.
    instruments : InstrumentsConfig, optional
        Instruments of ``"vision"``, and of no other fidelity.
    folder : str or pathlib.Path, optional
        New or empty folder for images, recording, truth and a video; needed by ``"vision"``, and by no other fidelity.

    Returns
    -------
    recording : Recording
        What the rover sensed; the input of `localize`.
    truth : Truth
        The terrain and the path that was driven, for scoring.

    Raises
    ------
    InputError
        The route leaves the terrain, or is in another CRS; the folder is not empty.
    ConfigError
        An argument of another fidelity, or ``"vision"`` without a folder.

    Notes
    -----
    With ``"vision"`` the rover steers by its real pose, and takes about a second of CPU time for a metre. A drive
    that ends early (a crevasse, an empty battery) is logged as a warning and described in ``drive.json``. Camera,
    scenery, faults and a rover that steers by its own estimate are settings of a mission (`run_mission`).

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
    _refuse_other_fidelity(
        fidelity, {"sensors": sensors, "aids": aids}, {"instruments": instruments, "folder": folder}
    )
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
        instruments=instruments or InstrumentsConfig(),
    )
    if folder is not None:
        return _simulated_in_images(terrain, route, mission, Path(folder))
    return (simulate_ideal if fidelity == "ideal" else simulate_statistical)(terrain, route, mission)


def _refuse_other_fidelity(fidelity: str, drawn: dict[str, object], rendered: dict[str, object]) -> None:
    """Refuse arguments that the fidelity would not use, and images without a place for them."""
    unused = drawn if fidelity == "vision" else rendered
    for name, value in unused.items():
        if value is not None:
            raise ConfigError(
                f"the fidelity {fidelity!r} does not use {name}; leave it out, or choose another fidelity."
            )
    if fidelity == "vision" and rendered["folder"] is None:
        raise ConfigError(
            "the fidelity 'vision' writes images; give a folder for them, such as folder='drive'."
        )


def _simulated_in_images(
    terrain: Dem, route: Route, mission: MissionConfig, folder: Path
) -> tuple[Recording, Truth]:
    """Simulate a drive with rendered images, and write it."""
    from sim.simulate.vision import simulate_vision  # heavy: physics and compiled rendering

    drive = simulate_vision(terrain, route, mission, folder / "recording")
    drive.write(folder)
    if drive.ending.value != "arrived":
        logger.warning(
            "the drive ended after %.1f m of %.1f m: %s", drive.progress_m, drive.route_m, drive.ending.value
        )
    return drive.recording, drive.truth
