"""Fine terrain of a site: heights, materials and normals at 0.25 m or finer.

`FineTerrain` holds them. `fine_terrain` makes it from a terrain model: it refines the cells, adds dunes, sastrugi and
hummocks, and carves the hazards of `sim.world.hazards`. Relief is a band-limited Gaussian random field, by the inverse
Fourier transform of a random spectrum.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS
from scipy import fft
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter

from sim.config.world import SceneryConfig
from sim.world import hazards
from sim.world.hazards import FloatGrid, Ground, Hazard
from survey import Dem, InputError
from survey.core import FloatArray, stream

ByteGrid = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class FineTerrain:
    """Fine terrain: heights on a grid of 0.25 m or finer, surface properties, and hazards.

    Between the nodes the surface is bilinear: `elevation`, the physics, the images and the
    laser see the same ground.

    `height` (H, W): elevation [m]; the first row is the northern one, as in a `Dem`. `transform`: of the
    cells around the nodes, as in a `Dem`. `crs`: projected, in metres. `vertical_datum`: of the terrain it
    was made from. `tone` (H, W): reflectance as a share of clean snow's, 255 for all of it. `water` (H, W):
    share of open water, 255 for all. `openness` (H, W): share of the sky that a place sees, 255 for all;
    small in crevasses. `hazards`: crevasses, channels, pools, cones and boulders with their outlines. `surface`,
    `snow_cover`: what the glacier's surface is made of, as in `SceneryConfig`.

    A height field has no overhangs: a crevasse's walls are one cell wide.
    """

    height: FloatGrid
    transform: Affine
    crs: CRS
    vertical_datum: str
    tone: ByteGrid
    water: ByteGrid
    openness: ByteGrid
    hazards: tuple[Hazard, ...]
    surface: Literal["snow", "bare ice", "debris"] = "snow"
    snow_cover: float = 0.0

    @property
    def step_m(self) -> float:
        """Distance between neighbouring nodes [m]."""
        return float(self.transform.a)

    @property
    def origin(self) -> FloatArray:
        """Easting and northing of the south-western node [m]."""
        rows, _ = self.height.shape
        step = self.step_m
        return np.array([self.transform.c + 0.5 * step, self.transform.f - (rows - 0.5) * step])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the outermost nodes [m]."""
        rows, columns = self.height.shape
        x, y = self.origin.tolist()
        return x, y, x + (columns - 1) * self.step_m, y + (rows - 1) * self.step_m

    @cached_property
    def dem(self) -> Dem:
        """Heights as a terrain model (a copy in double precision)."""
        return Dem(self.height.astype(np.float64), self.transform, self.crs, self.vertical_datum)

    def elevation(self, xy: FloatArray) -> FloatArray:
        """Return the height of places (N, 2) [m]; NaN beyond the outermost nodes."""
        corners, s, t, inside = self._patches(xy)
        south_west, south_east, north_west, north_east = corners
        south = south_west + (south_east - south_west) * s
        north = north_west + (north_east - north_west) * s
        return np.where(inside, south + (north - south) * t, np.nan)

    def normal(self, xy: FloatArray) -> FloatArray:
        """Return the surface's unit normals (N, 3), pointing up, at places (N, 2); NaN beyond the nodes."""
        corners, s, t, inside = self._patches(xy)
        south_west, south_east, north_west, north_east = corners
        to_east = (south_east - south_west) * (1.0 - t) + (north_east - north_west) * t
        to_north = (north_west - south_west) * (1.0 - s) + (north_east - south_east) * s
        up = np.column_stack([-to_east, -to_north, np.full(len(s), self.step_m)])
        up[~inside] = np.nan
        normals: FloatArray = up / np.linalg.norm(up, axis=1, keepdims=True)
        return normals

    def _patches(self, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Return the heights of the four nodes around each place (SW, SE, NW, NE), the place between them, and whether it is inside."""
        rows, columns = self.height.shape
        uv = (np.asarray(xy, dtype=np.float64).reshape(-1, 2) - self.origin) / self.step_m
        inside = (uv >= 0.0).all(axis=1) & (uv[:, 0] <= columns - 1) & (uv[:, 1] <= rows - 1)
        uv = np.where(inside[:, None], uv, 0.0)
        column = np.minimum(uv[:, 0].astype(np.int64), columns - 2)
        row = rows - 1 - np.minimum(uv[:, 1].astype(np.int64), rows - 2)
        z = self.height
        around = z[row, column], z[row, column + 1], z[row - 1, column], z[row - 1, column + 1]
        corners = np.stack(around).astype(np.float64)
        return corners, uv[:, 0] - column, uv[:, 1] - (rows - 1 - row), inside


def fine_terrain(terrain: Dem, config: SceneryConfig, seed: int) -> FineTerrain:
    """Add fine relief and hazards to a terrain model.

    The heights at the terrain's cell centres are preserved (a cubic spline interpolates them);
    the fine relief and the hazards are added. The last result is cached: asking again for the
    same costs nothing.

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
    if config.surface != "snow":
        below = gaussian_filter(height, _SHELTER_M / step) - height
        ground.openness[:] *= np.clip(1.0 - below / _SHELTER_M, 0.4, 1.0)
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
        tuple(hazards.place_hazard(hazard, transform) for hazard in found),
        config.surface,
        config.snow_cover,
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


_SHELTER_M = 0.6
"""Width of the surroundings that hide the sky from hollows between boulders and hummocks [m]."""
_Form = tuple[str, float, tuple[float, float], float, float]
_ROUGH_FORMS: dict[str, tuple[_Form, ...]] = {
    "bare ice": (("crust", 0.03, (0.5, 3.0), 0.8, 1.0),),
    "debris": (("mounds", 0.25, (5.0, 40.0), 1.2, 1.0), ("rubble", 0.05, (0.5, 4.0), 0.8, 1.0)),
}
"""Relief of ground without snow: name, standard deviation [m], wavelengths [m], decay and stretch."""


def _add_relief(height: FloatGrid, step_m: float, config: SceneryConfig, seed: int) -> None:
    wind = np.radians(270.0 - config.wind_from_deg)
    snow: tuple[_Form, ...] = (
        ("dunes", config.dune_sd_m, (3.0, 25.0), 1.2, 2.0),
        ("sastrugi", config.sastrugi_sd_m, (1.0, 4.0), 0.5, 3.0),
    )
    hummocks = ("hummocks", config.hummock_sd_m, (2.0, 12.0), 1.0, 1.0)
    for name, sd_m, wavelengths_m, decay, stretch in (*_ROUGH_FORMS.get(config.surface, snow), hummocks):
        if sd_m > 0.0:
            rng = stream(seed, "scenery", name)
            # The first row lies in the north, so that the angle from east turns the other way round.
            height += np.float32(sd_m) * band_limited_field(
                height.shape, step_m, wavelengths_m, decay, rng, stretch=stretch, angle=-wind
            )


def _add_hazards(ground: Ground, config: SceneryConfig, seed: int) -> list[Hazard]:
    hectares = float(ground.size_m.prod()) / 1e4
    densities = _densities(config)
    rng = {name: stream(seed, "scenery", name) for name in densities}
    count = {name: int(per_ha * hectares + rng[name].random()) for name, per_ha in densities.items()}
    carve: dict[str, Callable[[], Hazard | None]] = {
        "pools": lambda: hazards.melt_pool(ground, rng["pools"]),
        "channels": lambda: hazards.melt_channel(ground, rng["channels"]),
        "rills": lambda: hazards.melt_channel(ground, rng["rills"], _RILL_WIDTH_M),
        "crevasses": lambda: hazards.crevasse(ground, rng["crevasses"], config.crevasse_depth_m),
        "bridges": lambda: hazards.bridged_crevasse(ground, rng["bridges"]),
        "cones": lambda: hazards.dirt_cone(ground, rng["cones"]),
    }
    found = [hazard for name in carve for hazard in hazards.carve_hazards(ground, count[name], carve[name])]
    if config.surface == "debris":
        boulders = stream(seed, "scenery", "boulders")
        found += hazards.scatter_boulders(ground, boulders, config.boulders_per_ha * hectares)
    return found


_RILL_WIDTH_M = 0.25, 0.6
_RILLS_PER_HA = 20.0


def _densities(config: SceneryConfig) -> dict[str, float]:
    """Return the number of each kind of hazard per hectare."""
    return {
        "pools": config.pools_per_ha,
        "channels": config.channels_per_ha,
        "crevasses": config.crevasses_per_ha * (1.0 - config.bridged_share),
        "bridges": config.crevasses_per_ha * config.bridged_share,
        "cones": config.dirt_cones_per_ha,
        "rills": _RILLS_PER_HA * (config.surface == "bare ice"),
    }


def band_limited_field(
    shape: tuple[int, int],
    step_m: float,
    wavelengths_m: tuple[float, float],
    decay: float,
    rng: np.random.Generator,
    *,
    stretch: float = 1.0,
    angle: float = 0.0,
    periodic: bool = False,
) -> FloatGrid:
    """Draw a Gaussian random field of unit variance with wavelengths within bounds.

    `shape` (2,) int: rows and columns wanted. `step_m`: distance between nodes [m]. `wavelengths_m` (2,):
    shortest and longest wavelength, across the forms [m]. `stretch`, `angle`: forms are `stretch` times
    longer in the direction `angle` (from the columns' axis towards the rows') [rad].
    """
    # The transform is periodic: without a margin the opposite sides of a site would be alike.
    pad = 0 if periodic else int(np.ceil(min(wavelengths_m[1], 40.0) / step_m))
    rows, columns = (n if periodic else fft.next_fast_len(n + pad, real=True) for n in shape)
    x = fft.rfftfreq(columns, step_m).astype(np.float32)[None, :]
    y = fft.fftfreq(rows, step_m).astype(np.float32)[:, None]
    cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    squared = (np.float32(stretch) * (cos * x + sin * y)) ** 2 + (cos * y - sin * x) ** 2
    band = (squared > wavelengths_m[1] ** -2) & (squared < wavelengths_m[0] ** -2)
    amplitude = np.zeros_like(squared)
    amplitude[band] = squared[band] ** np.float32(-0.5 * decay)
    spectrum = np.zeros(squared.shape, np.complex64)
    draws = rng.standard_normal((2, int(band.sum())), np.float32)
    spectrum[band] = amplitude[band] * (draws[0] + 1j * draws[1])
    field = fft.irfft2(spectrum, s=(rows, columns), overwrite_x=True)[: shape[0], : shape[1]]
    return np.ascontiguousarray(field / field.std(), dtype=np.float32)
