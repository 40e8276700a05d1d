"""Assembly of a simulated drive from a mission: rover physics, camera, stakes."""

import numpy as np

from sim.config.mission import MissionConfig
from sim.config.scene import AppearanceConfig
from sim.instruments.camera import RoverCamera
from sim.rendering import Renderer, RoverBox
from sim.vehicle.physics import HeightField, KinematicRover, Physics
from sim.vehicle.pursuit import PurePursuit
from sim.vehicle.rover import ContactRover
from sim.world.fine_terrain import FineTerrain
from survey.core.arrays import FloatArray
from survey.data.camera.calibration import Camera


def rover_physics(ground: HeightField, path: FloatArray, mission: MissionConfig) -> Physics:
    """Return the physics of a rover at the start of a path, heading along it."""
    kind = KinematicRover if mission.physics.engine == "kinematic" else ContactRover
    ahead = path[1] - path[0]
    return kind(ground, mission.physics, mission.rover, path[0], float(np.arctan2(ahead[1], ahead[0])))


def camera_on_rover(
    ground: FineTerrain, look: AppearanceConfig, camera: Camera, mission: MissionConfig
) -> RoverCamera:
    """Return the rover's camera; the rover casts a shadow in its images."""
    renderer = Renderer(
        ground,
        look,
        camera,
        mission.site_seed,
        noise_seed=mission.seed,
        imaging=mission.imaging,
        wind_from_deg=mission.scenery.wind_from_deg,
    )
    physics = mission.physics
    length = physics.track_length_m + 2.0 * physics.wheel_radius_m
    size = length, physics.track_gauge_m + physics.wheel_radius_m, 0.3

    def box(T_world_body: FloatArray) -> RoverBox:
        T_body_box = np.eye(4)
        T_body_box[2, 3] = 0.5 * size[2] + 0.05
        return RoverBox(size, T_world_body @ T_body_box)

    return RoverCamera(renderer, exposure_s=mission.imaging.exposure_s, box=box)


def stakes_beside(ground: HeightField, pursuit: PurePursuit, mission: MissionConfig) -> FloatArray:
    """Return places (K, 3) of stakes beside the route, left and right in turn; those beyond the map are left out."""
    config = mission.instruments.stakes
    along = (np.arange(config.count) + 0.5) * pursuit.length_m / max(config.count, 1)
    xy, heading = pursuit.at(along)
    side = config.beside_m * np.where(np.arange(config.count) % 2, -1.0, 1.0)[:, None]
    feet = xy + side * np.column_stack([-np.sin(heading), np.cos(heading)])
    place: FloatArray = np.column_stack([feet, ground.elevation(feet)])
    known: FloatArray = place[np.isfinite(place[:, 2])]
    return known
