r"""Flow and melt of a simulated glacier.

Places are those of the start of the drive, X; at the time t the ice of X is at x = X + v(X) t and the surface is lower by
a(t). Across a valley of half width w the surface velocity of a glacier of parabolic bed is close to

.. math::  v(y) = v_0 \left( s + (1 - s) \left( 1 - (|y| / w)^{n + 1} \right) \right)

with n the exponent of Glen's law and s the share of sliding: shear is concentrated at the margins.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim.config.ice import IceConfig
from sim.config.mission import MissionConfig
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.trajectory import Trajectory

_DAY_S = 86400.0
_WARMEST_S = 14.0 * 3600.0
_PASSES = 6


@dataclass(frozen=True)
class MovingIce:
    """Motion of the ice since the start of a drive.

    Parameters
    ----------
    config : IceConfig
        Flow and melt.
    middle : (2,) ndarray
        A place on the centre line [m].
    velocity : tuple of Dem, optional
        Rasters of the velocity to the east and to the north [m/day].
    """

    config: IceConfig
    middle: FloatArray
    velocity: tuple[Dem, Dem] | None = None

    def velocities(self, xy: FloatArray) -> FloatArray:
        """Return the velocity (N, 2) of the ice that starts at places (N, 2) [m/day]."""
        if self.velocity is not None:
            read = np.column_stack([raster.at(xy) for raster in self.velocity])
            return np.where(np.isfinite(read), read, 0.0)
        config, angle = self.config, np.radians(self.config.direction_deg)
        along = np.array([np.cos(angle), np.sin(angle)])
        speed = np.full(len(xy), config.velocity_m_per_day)
        if config.flow == "valley":
            aside = (xy - self.middle) @ np.array([-along[1], along[0]]) / config.half_width_m
            deforming = 1.0 - np.minimum(np.abs(aside), 1.0) ** (config.flow_exponent + 1.0)
            speed *= config.margin_share + (1.0 - config.margin_share) * deforming
        velocity: FloatArray = speed[:, None] * along
        return velocity

    def lowering(self, time_s: FloatArray) -> FloatArray:
        """Return the melt since the start of the drive (N,) [m]."""
        config, turn = self.config, 2.0 * np.pi / _DAY_S
        begin = turn * (3600.0 * config.start_hour - _WARMEST_S)
        wave = (np.sin(turn * time_s + begin) - np.sin(begin)) / turn
        melted: FloatArray = config.melt_m_per_day / _DAY_S * (time_s + config.diurnal_share * wave)
        return melted

    def displacement(self, xy: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return how far the surface that starts at places (N, 2) has moved by some times (N, 3) [m]."""
        days = np.asarray(time_s)[:, None] / _DAY_S
        return np.column_stack([self.velocities(xy) * days, -self.lowering(np.asarray(time_s))])

    def starts(self, xy: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return where the ice that is at places (N, 2) at some times was at the start [m]."""
        places = xy
        for _ in range(_PASSES):
            places = xy - self.displacement(places, time_s)[:, :2]
        return places

    def carried(self, trajectory: Trajectory) -> Trajectory:
        """Return a path in fixed coordinates from the path on the ice."""
        moved = self.displacement(trajectory.position[:, :2], trajectory.time_s)
        return replace(trajectory, position=trajectory.position + moved)

    def terrain_at(self, terrain: Dem, time_s: float) -> Dem:
        """Return the terrain at a time; beyond the edge it goes on as it is there.

        Parameters
        ----------
        terrain : Dem
            Terrain of the start of the drive.
        time_s : float
            Time since then [s].

        Returns
        -------
        Dem
            On the same grid.
        """
        grid = terrain.grid()
        times = np.full(len(grid.xy), time_s)
        xmin, ymin, xmax, ymax = grid.bounds
        starts = np.clip(self.starts(grid.xy, times), (xmin, ymin), (xmax, ymax))
        height = terrain.at(starts) - self.lowering(times)
        return Dem.on(grid, height.reshape(grid.shape), terrain.vertical_datum)


def moving_ice(mission: MissionConfig, terrain: Dem) -> MovingIce | None:
    """Return the motion of the ice of a mission, or None where the mission states none.

    Parameters
    ----------
    mission : MissionConfig
        Its section ``ice``.
    terrain : Dem
        Its terrain, whose middle lies on the centre line.

    Returns
    -------
    MovingIce or None
        Flow and melt.

    Raises
    ------
    InputError
        Velocity rasters in another CRS than the terrain.
    """
    config = mission.ice
    if config is None:
        return None
    xmin, ymin, xmax, ymax = terrain.bounds
    middle = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
    if config.velocity_files is None:
        return MovingIce(config, middle)
    east, north = (Dem.read(mission.path(file)) for file in config.velocity_files)
    for raster in (east, north):
        if raster.crs != terrain.crs:
            raise InputError(
                f"ice.velocity_files are in {raster.crs.name} and the terrain in {terrain.crs.name}; warp them to that of the "
                "terrain first."
            )
    return MovingIce(config, middle, (east, north))


def epoch_of(recording: Recording, mission: MissionConfig) -> float:
    """Return the epoch of the map of a recording on moving ice [s]: that of the mission, or the middle of the drive.

    Parameters
    ----------
    recording : Recording
        Its fixes begin and end with the drive.
    mission : MissionConfig
        Its section ``ice``.

    Returns
    -------
    float
        In seconds of the recording.
    """
    stated = None if mission.ice is None else mission.ice.epoch_s
    return float(np.mean(recording.gps.time_s[[0, -1]])) if stated is None else stated
