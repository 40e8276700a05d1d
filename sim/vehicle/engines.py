"""Choice of the rigid-body engine of the contact physics."""

from importlib.util import find_spec

from sim.vehicle.bodies import GroundPatch, RigidBodies, RoverBodies
from survey.core.errors import ConfigError

_MODULES = {"bullet": "pybullet", "mujoco": "mujoco"}


def chosen_engine(name: str) -> str:
    """Return the rigid-body engine that a mission asks for; ``contact`` means the first one installed.

    Raises
    ------
    ConfigError
        The engine is not installed, or none is.
    """
    wanted = list(_MODULES) if name == "contact" else [name]
    for engine in wanted:
        if find_spec(_MODULES[engine]) is not None:
            return engine
    missing = " nor ".join(_MODULES[engine] for engine in wanted)
    neither = "neither " if len(wanted) > 1 else ""
    raise ConfigError(
        f"physics.engine is {name!r}, and {neither}{missing} is {'' if neither else 'not '}installed; "
        f'install {_MODULES[wanted[-1]]}, or set physics.engine = "kinematic".'
    )


def rigid_bodies(bodies: RoverBodies, patch: GroundPatch) -> RigidBodies:
    """Return the rover and its ground in the engine of the configuration.

    Raises
    ------
    ConfigError
        The engine is not installed.
    """
    if chosen_engine(bodies.config.engine) == "bullet":
        from sim.vehicle.bullet import BulletBodies

        return BulletBodies(bodies, patch)
    from sim.vehicle.mujoco_bodies import MujocoBodies

    return MujocoBodies(bodies, patch)
