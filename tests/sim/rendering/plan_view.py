"""Top-down radiance map of the rendered surface, for tests of repeating patterns."""

import numpy as np

from sim.rendering.compiled import Floats, by_share
from sim.rendering.footprint import Aim, Footprints
from sim.rendering.light import shade
from sim.rendering.renderer import Renderer, read_surface
from sim.rendering.scene import RenderScene
from survey.core.arrays import FloatArray

_NO_HAZE_M = 1e12
_IN_SHADE = 0.3


def plan_view(
    renderer: Renderer,
    south_west: tuple[float, float],
    shape: tuple[int, int],
    texel_m: float,
) -> Floats:
    """Return the radiance of a rectangle of the site without water's mirror, (rows, columns), north up.

    Parameters
    ----------
    renderer : Renderer
        The scene.
    south_west : (2,) tuple of float
        Easting and northing of the south-western texel [m].
    shape : (2,) tuple of int
        Rows and columns.
    texel_m : float
        Distance between texels [m]; what is finer is averaged away by the mipmaps.
    """
    radiance = np.empty(shape, np.float32)
    corner = np.array(south_west) - renderer.terrain.origin
    _fill(renderer.scene, corner, texel_m, radiance)
    return np.ascontiguousarray(radiance[::-1])


@by_share
def _fill(scene: RenderScene, corner: FloatArray, texel_m: float, radiance: Floats) -> None:
    rows, columns = radiance.shape
    f, n = np.zeros((26, columns), np.float32), np.zeros((10, columns), np.int32)
    at = Footprints(
        f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8], f[9], f[10], f[11], f[12], f[13], f[14], f[15],
        f[16], f[17], n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7],
    )  # fmt: skip
    to = Aim(f[18], f[19], f[20], f[21], f[22], f[23], f[24], f[25], n[8], n[9])
    level, grain_level, map_level = 0, 0, 0
    while 0.01 * 2**level < 0.99 * texel_m:
        level += 1
    while 0.0025 * 2**grain_level < 0.99 * texel_m and grain_level < 4:
        grain_level += 1
    while scene.surface.step_m * 2**map_level < 0.99 * texel_m:
        map_level += 1
    at.ux[:], at.taps[:], at.grain_taps[:] = 1.0, 1, 1
    at.width_m[:], at.level[:], at.grain_level[:], at.map_level[:] = texel_m, level, grain_level, map_level
    origin = np.array([corner[0], 0.0, 0.0])
    for row in range(rows):
        origin[1] = corner[1] + row * texel_m
        for c in range(columns):
            at.range_m[c] = c * texel_m
            at.x[c], at.y[c] = origin[0] + c * texel_m, origin[1]
        at.texture[:], at.direct[:], at.ambient[:], at.water[:] = 0.0, 0.0, 0.0, 0.0
        read_surface(columns, at, to, scene, origin)
        shade(columns, at, _IN_SHADE, _NO_HAZE_M)
        radiance[row] = at.radiance
