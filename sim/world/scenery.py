"""Fine terrain: a terrain model with dunes, sastrugi, hummocks and hazards at 0.25 m or finer."""

import hashlib
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from affine import Affine
from scipy.interpolate import make_interp_spline

from sim.config.scene import SceneryConfig
from sim.world import hazards
from sim.world.band_limited import band_limited_field
from sim.world.fine_terrain import ByteGrid, FineTerrain
from sim.world.hazards import FloatGrid, Ground, Hazard
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.data.dem import Dem


def fine_terrain(terrain: Dem, config: SceneryConfig, seed: int) -> FineTerrain:
    """Add fine relief and hazards to a terrain model.

    The heights at the terrain's cell centres are preserved (a cubic spline interpolates them);
    the fine relief and the hazards are added. The last result is cached: asking again for the
    same costs nothing.

    Parameters
    ----------
    terrain : Dem
        The site, without nodata.
    config : SceneryConfig
        Wind, relief, hazards.
    seed : int
        The mission's; equal seeds give equal ground.

    Raises
    ------
    InputError
        The terrain holds unknown cells or fewer than 4 × 4.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> site = Dem.on(Grid((0.0, 0.0, 30.0, 20.0), 1.0), np.zeros((21, 31)))
    >>> ground = fine_terrain(site, SceneryConfig(crevasses_per_ha=20.0, bridged_share=0.0), seed=1)
    >>> ground.height.shape, ground.hazards[0].kind
    ((81, 121), 'crevasse')
    >>> inside = ground.hazards[0].outline.point_on_surface()
    >>> bool(ground.elevation(np.array([[inside.x, inside.y]]))[0] < -3.0)
    True
    """
    return _built(_Site(terrain), config, seed)


class _Site:
    """Cache key of a terrain: equal for the same heights at the same place."""

    def __init__(self, terrain: Dem) -> None:
        self.terrain = terrain
        content = repr((terrain.shape, terrain.transform, terrain.vertical_datum)).encode()
        self._digest = hashlib.sha256(content + terrain.elevation.tobytes()).digest()

    def __hash__(self) -> int:
        return hash(self._digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Site) and other._digest == self._digest


@lru_cache(maxsize=1)
def _built(site: _Site, config: SceneryConfig, seed: int) -> FineTerrain:
    terrain = site.terrain
    height, step = _refined(terrain, config.step_m)
    _add_relief(height, step, config, seed)
    ones = np.ones_like(height)
    ground = Ground(height, ones, np.zeros_like(height), ones.copy(), step)
    found = _add_hazards(ground, config, seed)
    corner = terrain.transform @ Affine.translation(0.5, 0.5) @ Affine.scale(step / terrain.step_m)
    transform = corner @ Affine.translation(-0.5, -0.5)
    return FineTerrain(
        height,
        transform,
        terrain.crs,
        terrain.vertical_datum,
        _bytes(ground.tone),
        _bytes(ground.water),
        _bytes(ground.openness),
        tuple(hazards.placed(hazard, transform) for hazard in found),
    )


def _bytes(share: FloatGrid) -> ByteGrid:
    in_bytes: ByteGrid = np.rint(np.clip(share, 0.0, 1.0) * 255.0).astype(np.uint8)
    return in_bytes


def _refined(terrain: Dem, step_m: float) -> tuple[FloatGrid, float]:
    """Interpolate the heights by a cubic spline, at steps that divide the terrain's cells."""
    n_unknown = int(np.isnan(terrain.elevation).sum())
    if n_unknown or min(terrain.shape) < 4:
        raise InputError(
            f"the terrain has {terrain.shape[0]} × {terrain.shape[1]} cells, {n_unknown} of them unknown; fine ground needs "
            "4 × 4 or more and none unknown, choose another area or fill them."
        )
    parts = int(np.ceil(terrain.step_m / step_m - 1e-9))
    rows, columns = ((n - 1) * parts + 1 for n in terrain.shape)
    along_y = make_interp_spline(np.arange(terrain.shape[0]), terrain.elevation)(np.arange(rows) / parts)
    along_x = make_interp_spline(np.arange(terrain.shape[1]), along_y, axis=1)
    height = np.empty((rows, columns), np.float32)
    for first in range(0, columns, 256):  # strips keep the double-precision copy small
        part = slice(first, min(first + 256, columns))
        height[:, part] = along_x(np.arange(part.start, part.stop) / parts)
    return height, terrain.step_m / parts


def _add_relief(height: FloatGrid, step_m: float, config: SceneryConfig, seed: int) -> None:
    wind = np.radians(270.0 - config.wind_from_deg)
    forms = (
        ("dunes", config.dune_sd_m, (3.0, 25.0), 1.2, 2.0),
        ("sastrugi", config.sastrugi_sd_m, (1.0, 4.0), 0.5, 3.0),
        ("hummocks", config.hummock_sd_m, (2.0, 12.0), 1.0, 1.0),
    )
    for name, sd_m, wavelengths_m, decay, stretch in forms:
        if sd_m > 0.0:
            rng = stream(seed, "scenery", name)
            # The first row lies in the north, so that the angle from east turns the other way round.
            height += np.float32(sd_m) * band_limited_field(
                height.shape, step_m, wavelengths_m, decay, rng, stretch=stretch, angle=-wind
            )


def _add_hazards(ground: Ground, config: SceneryConfig, seed: int) -> list[Hazard]:
    hectares = float(ground.size_m.prod()) / 1e4
    rng = {
        name: stream(seed, "scenery", name) for name in ("pools", "channels", "crevasses", "bridges", "cones")
    }
    count = {name: int(per_ha * hectares + rng[name].random()) for name, per_ha in _densities(config).items()}
    carve: dict[str, Callable[[], Hazard | None]] = {
        "pools": lambda: hazards.melt_pool(ground, rng["pools"]),
        "channels": lambda: hazards.melt_channel(ground, rng["channels"]),
        "crevasses": lambda: hazards.crevasse(ground, rng["crevasses"], config.crevasse_depth_m),
        "bridges": lambda: hazards.bridged_crevasse(ground, rng["bridges"]),
        "cones": lambda: hazards.dirt_cone(ground, rng["cones"]),
    }
    return [hazard for name in carve for hazard in hazards.carved(ground, count[name], carve[name])]


def _densities(config: SceneryConfig) -> dict[str, float]:
    """Return the number of each kind of hazard per hectare."""
    return {
        "pools": config.pools_per_ha,
        "channels": config.channels_per_ha,
        "crevasses": config.crevasses_per_ha * (1.0 - config.bridged_share),
        "bridges": config.crevasses_per_ha * config.bridged_share,
        "cones": config.dirt_cones_per_ha,
    }
