"""Renderer: images of the fine terrain from a calibrated camera, exact depth, and optical flow.

A `RenderScene` (`sim.rendering.scene`) is what images show. `render_rows` paints the rows of an image in parallel threads:
rays, surface lookup and shading. `Renderer` gives the image at a pose; during the exposure every row has a pose of its own.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from sim.config.world import AppearanceConfig, ImagingConfig
from sim.rendering.clouds import drift_m, paint_clouds, shade_by_clouds
from sim.rendering.colour import blue_green_red, find_bare, tint_ground, tint_sky
from sim.rendering.compiled import (
    Doubles,
    Floats,
    Ints,
    by_share,
    f32,
    i32,
    row_loop,
    scalar,
    share_out,
    u32,
)
from sim.rendering.far_ground import far_ranges, far_view, shade_far
from sim.rendering.footprint import (
    GRAIN_FROM_M,
    Aim,
    Footprints,
    aim,
    lattice,
    lay_snow,
    measure,
    read_map,
    read_tile,
    to_level,
)
from sim.rendering.light import (
    OWN_SHADOW_REACH_M,
    ImageSensor,
    Light,
    add_shadow_and_water,
    backdrop_row,
    shade,
    shadow_width_m2,
)
from sim.rendering.ruts import RutMap, Ruts, no_ruts, press_ruts
from sim.rendering.scene import RenderScene, scene_of
from sim.rendering.visibility import (
    EDGE,
    FOUND,
    OUTSIDE,
    SKY,
    RowRays,
    Surface,
    View,
    first_hit,
    height_and_gradient,
    meet_ground,
    row_slopes,
    sample_ranges,
    sweep,
    view_of,
)
from sim.world.appearance import (
    sun_direction,
)
from sim.world.fine_terrain import FineTerrain
from survey import Camera, Dem, InputError
from survey.core import FloatArray
from survey.data.frames import Image

_ROWS_AT_ONCE = 4
_FARTHEST_M = 3000.0
_ROUNDED_M2 = 0.01


class AroundView(NamedTuple):
    """Directions and table of 1 / range of the ground around the site."""

    directions: View
    table: Floats


class Lens(NamedTuple):
    """Unit directions of all pixels in the camera frame, (H, W) each, and the angle of one pixel."""

    x: Floats
    y: Floats
    z: Floats
    pixel_rad: float


@by_share
def render_rows(
    worker: int,
    n_workers: int,
    lens: Lens,
    rotations: Doubles,
    origins: Doubles,
    view: View,
    table: Floats,
    around: AroundView,
    scene: RenderScene,
    light: Light,
    ruts: RutMap,
    most_taps: int,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
    ratios: Floats,
) -> None:
    """Fill radiance and depth (along the ray, -1 for sky), (H, W); each row has its own pose.

    `ratios` (H, 2, W): filled with red and blue over the radiance, unless it has no columns.
    """
    n_rows, width = lens.x.shape
    f, n = np.empty((44, width), np.float32), np.empty((12, width), np.int32)
    rays = RowRays(f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8], n[0])
    at = Footprints(
        f[9], f[10], f[11], f[12], f[13], f[14], f[15], f[16], f[17], f[18], f[19], f[20], f[21], f[22], f[23],
        f[24], f[25], f[26], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8],
    )  # fmt: skip
    to = Aim(f[27], f[28], f[29], f[30], f[31], f[32], f[33], f[34], n[9], n[10])
    far_rays = RowRays(f[35], f[36], f[37], f[38], f[39], f[40], f[41], f[42], f[43], n[11])
    height, flat_table = scene.surface.height, table.ravel()
    flat_height = height.ravel()
    far = scene.far
    far_height, far_table = far.surface.height.ravel(), around.table.ravel()
    shift = np.array([far.x, far.y, 0.0])
    for block in range(worker, (n_rows + _ROWS_AT_ONCE - 1) // _ROWS_AT_ONCE, n_workers):
        for row in range(block * _ROWS_AT_ONCE, min((block + 1) * _ROWS_AT_ONCE, n_rows)):
            meet_ground(
                lens.x[row], lens.y[row], lens.z[row], rotations[row], origins[row], view, flat_table,
                table.shape[1], flat_height, height.shape[1], height.shape[0], scene.surface.step_m, rays,
            )  # fmt: skip
            _paint_row(
                rays,
                at,
                to,
                origins[row],
                scene,
                light,
                ruts,
                lens.pixel_rad,
                most_taps,
                shaded,
                radiance[row],
                depth[row],
                ratios[row],
            )
            if far.reach_m > 0.0 and _has_sky(rays):
                origin = origins[row] - shift
                meet_ground(
                    lens.x[row], lens.y[row], lens.z[row], rotations[row], origin, around.directions, far_table,
                    around.table.shape[1], far_height, far.surface.height.shape[1], far.surface.height.shape[0],
                    far.surface.step_m, far_rays,
                )  # fmt: skip
                _paint_far_row(
                    rays, far_rays, at, to, origin, scene, light, lens.pixel_rad, most_taps, shaded, radiance[row],
                    depth[row], ratios[row],
                )  # fmt: skip


@scalar
def _paint_row(
    rays: RowRays,
    at: Footprints,
    to: Aim,
    origin: Doubles,
    scene: RenderScene,
    light: Light,
    ruts: RutMap,
    pixel_rad: float,
    most_taps: int,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
    ratios: Floats,
) -> None:
    walk_edges(rays, scene.surface, origin, _FARTHEST_M)
    n_ground = _paint_sky(rays, scene, origin, light, pixel_rad, shaded, radiance, depth, at, ratios)
    if n_ground == 0:
        return
    measure(n_ground, rays, origin[0], origin[1], pixel_rad, most_taps, scene.surface.step_m, at)
    if shaded:
        read_surface(n_ground, at, to, scene, origin)
        if ruts.heads.size > 1:
            press_ruts(n_ground, at, origin, light, ruts)
        if scene.clouds.mean > 0.0:
            shade_by_clouds(n_ground, at, rays, origin, light, scene.clouds)
        shade(n_ground, at, light.in_shade, light.haze_m)
        if _is_special(n_ground, at, rays, origin, light, at.taps):
            add_shadow_and_water(n_ground, at, at.taps, rays, origin, light, scene.backdrop)
        if ratios.size:
            find_bare(n_ground, at, light.bare_below, light.haze_m)
            tint_ground(n_ground, at, light.is_ice, ratios)
    for k in range(n_ground):
        radiance[at.pixel[k]] = at.radiance[k]
        depth[at.pixel[k]] = at.path_m[k]


@scalar
def _has_sky(rays: RowRays) -> bool:
    """Return whether a row has sky, behind which there may be far ground."""
    for c in range(rays.fate.size):  # noqa: SIM110
        if rays.fate[c] == SKY:
            return True
    return False


@scalar
def _paint_far_row(
    rays: RowRays,
    far_rays: RowRays,
    at: Footprints,
    to: Aim,
    origin: Doubles,
    scene: RenderScene,
    light: Light,
    pixel_rad: float,
    most_taps: int,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
    ratios: Floats,
) -> None:
    """Paint the ground around the site where the fine terrain leaves sky; `origin` counts from its own corner."""
    far, snow = scene.far, scene.snow
    for c in range(rays.fate.size):
        if rays.fate[c] != SKY:
            far_rays.fate[c] = i32(SKY)
    walk_edges(far_rays, far.surface, origin, far.reach_m)
    n_sky = rays.fate.size - rays.fate.size
    for c in range(rays.fate.size):
        if far_rays.fate[c] == FOUND:
            at.pixel[c - n_sky] = c
        else:
            n_sky += 1
    n = rays.fate.size - n_sky
    if n == 0:
        return
    measure(n, far_rays, origin[0], origin[1], pixel_rad, most_taps, far.surface.step_m, at)
    if shaded:
        lattice(n, at)
        for tap in range(2):
            read_map(
                tap, n, at, origin[0], origin[1], far.ground.words, far.ground.starts, far.ground.columns,
                far.ground.rows, far.surface.step_m,
            )  # fmt: skip
        aim(
            n, at, at.weight0, at.weight1, at.taps, at.level, snow.starts, snow.mask, snow.per_m, snow.gain, to,
        )  # fmt: skip
        read_tile(n, at, at.taps, to, snow.words)
        if scene.clouds.mean > 0.0:
            here = np.array([origin[0] + far.x, origin[1] + far.y, origin[2]])
            shade_by_clouds(n, at, far_rays, here, light, scene.clouds)
        shade_far(n, at, far_rays, light.in_shade, light.haze_m)
        if ratios.size:
            tint_ground(n, at, False, ratios)
    for k in range(n):
        radiance[at.pixel[k]] = at.radiance[k]
        depth[at.pixel[k]] = at.path_m[k]


@scalar
def walk_edges(rays: RowRays, surface: Surface, origin: Doubles, farthest_m: float) -> None:
    """Compute the exact range, or the sky, of pixels that the table cannot decide."""
    per_step = 1.0 / surface.step_m
    for c in range(rays.fate.size):
        if rays.fate[c] != EDGE and rays.fate[c] != OUTSIDE:
            continue
        ux, uy, slope = float(rays.ux[c]), float(rays.uy[c]), float(rays.slope[c])
        start, end = 0.0, farthest_m
        if rays.fate[c] == EDGE:
            start = max(0.7 / rays.nearest[c] - 2.5, 0.0)
            if rays.farthest[c] > 0.0:
                end = 1.03 / rays.farthest[c] + 0.1
        r = first_hit(surface, origin, ux, uy, slope, start, end)
        if r < 0.0:
            rays.fate[c] = i32(SKY)
            continue
        x, y = origin[0] + ux * r, origin[1] + uy * r
        z, gx, gy = height_and_gradient(surface.height, per_step, x, y)
        rays.range_m[c], rays.z[c], rays.gx[c], rays.gy[c] = f32(r), f32(z), f32(gx), f32(gy)
        rays.fate[c] = i32(FOUND)


@scalar
def _paint_sky(
    rays: RowRays,
    scene: RenderScene,
    origin: Doubles,
    light: Light,
    pixel_rad: float,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
    at: Footprints,
    ratios: Floats,
) -> int:
    """Paint the sky's pixels, list the others in `at.pixel`, and return how many those are."""
    scenery, ground, sky, painted = scene.backdrop, at.pixel, at.taps, at.radiance
    n = 0
    for c in range(rays.fate.size):
        if rays.fate[c] != SKY:
            ground[n] = c
            n += 1
        else:
            sky[c - n] = c
    # A counter that starts at the literal 0 would have `backdrop_row` compiled twice.
    n_sky = rays.fate.size - n
    for k in range(n_sky):
        depth[u32(sky[k])] = f32(-1)
    if shaded and n_sky:
        x, y = origin[0] - scenery.centre_x, origin[1] - scenery.centre_y
        faces = scenery.faces
        backdrop_row(
            n_sky, sky, rays.ux, rays.uy, rays.slope, faces.ravel(), faces.shape[1], faces.shape[2],
            scenery.distance_m, x, y, origin[2], painted,
        )  # fmt: skip
        if scene.clouds.mean > 0.0:
            open_sky = scenery.is_open
            backdrop_row(
                n_sky, sky, rays.ux, rays.uy, rays.slope, open_sky.ravel(), open_sky.shape[1], open_sky.shape[2],
                scenery.distance_m, x, y, origin[2], at.ambient,
            )  # fmt: skip
            paint_clouds(
                n_sky, sky, rays, origin, pixel_rad, light.haze_m, light, scene.clouds, at.ambient, painted, at.direct
            )  # fmt: skip
        if ratios.size:
            if scene.clouds.mean == 0.0:
                at.direct[:n_sky] = f32(0)
            tint_sky(n_sky, sky, rays, at.direct, ratios)
        for k in range(n_sky):
            radiance[u32(sky[k])] = painted[k]
    return n


@scalar
def read_rough_ground(n: int, at: Footprints, to: Aim, scene: RenderScene, origin: Doubles) -> None:
    """Read the texture of bare ice or debris with the snow on it."""
    ground, rough = scene.ground, scene.rough.tile
    for tap in range(2):
        read_map(
            tap, n, at, origin[0], origin[1], scene.rough.snow, ground.starts, ground.columns, ground.rows,
            scene.surface.step_m,
        )  # fmt: skip
    to_level(n, at, rough.per_m)
    aim(
        n, at, at.weight0, at.weight1, at.taps, at.level, rough.starts, rough.mask, rough.per_m, rough.gain, to,
    )  # fmt: skip
    read_tile(n, at, at.taps, to, rough.words)
    lay_snow(n, at, scene.rough.albedo)
    to_level(n, at, scene.snow.per_m)


@scalar
def read_surface(n: int, at: Footprints, to: Aim, scene: RenderScene, origin: Doubles) -> None:
    """Read light and texture over the footprints."""
    ground, snow, grain = scene.ground, scene.snow, scene.grain
    longest, narrowest = _extremes(n, at)
    lattice(n, at)
    if scene.rough.snow.size > 1:
        read_rough_ground(n, at, to, scene, origin)
    for tap in range(2 if longest > 0.6 else 1):
        read_map(
            tap, n, at, origin[0], origin[1], ground.words, ground.starts, ground.columns, ground.rows,
            scene.surface.step_m,
        )  # fmt: skip
    aim(
        n, at, at.weight0, at.weight1, at.taps, at.level, snow.starts, snow.mask, snow.per_m, snow.gain, to,
    )  # fmt: skip
    read_tile(n, at, at.taps, to, snow.words)
    if narrowest >= GRAIN_FROM_M:
        return
    aim(
        n, at, at.grain0, at.grain1, at.grain_taps, at.grain_level, grain.starts, grain.mask, grain.per_m, grain.gain,
        to,
    )  # fmt: skip
    read_tile(n, at, at.grain_taps, to, grain.words)


@row_loop
def _extremes(n: int, at: Footprints) -> tuple[float, float]:
    """Return the longest footprint and narrowest tap of a row."""
    longest, narrowest = f32(0), f32(1e9)
    for k in range(n):
        longest = max(longest, at.length_m[k])
        narrowest = min(narrowest, at.width_m[k])
    return longest, narrowest


@row_loop
def _is_special(n: int, at: Footprints, rays: RowRays, origin: Doubles, light: Light, special: Ints) -> bool:
    """Mark the pixels with a possible shadow of the rover or water; return whether there are any."""
    sx, sy, sz = f32(light.sun[0]), f32(light.sun[1]), f32(light.sun[2])
    ox, oy = f32(origin[0] - light.box_centre[0]), f32(origin[1] - light.box_centre[1])
    oz, wide = f32(light.box_centre[2]), f32(shadow_width_m2(light) + _ROUNDED_M2)
    reach = f32(OWN_SHADOW_REACH_M) if light.box_half_m[0] > 0.0 else f32(-1)
    found = i32(0)
    for k in range(n):
        r = at.range_m[k]
        x, y, z = ox + at.ux[k] * r, oy + at.uy[k] * r, rays.z[u32(at.pixel[k])] - oz
        along = x * sx + y * sy + z * sz
        may_be_shaded = (x * x + y * y + z * z - along * along < wide) & (r < reach)
        special[k] = i32(1) if may_be_shaded | (at.water[k] >= f32(0.001)) else i32(0)
    for k in range(n):
        found = max(found, special[k])
    return found > i32(0)


def lens_of(camera: Camera) -> Lens:
    """Return the rays of all pixels of a camera; refuse pixels without one."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()])).reshape(camera.height, camera.width, 3)
    if not np.isfinite(rays).all():
        raise InputError("some pixels of the camera have no ray (90° or more off the axis); narrow the lens.")
    x, y, z = (np.ascontiguousarray(rays[..., k], dtype=np.float32) for k in range(3))
    return Lens(x, y, z, 1.0 / float(camera.matrix[0, 0]))


def edge_rays(lens: Lens) -> Doubles:
    """Return the rays along the image's edges, which bound all others."""
    rays = np.stack([lens.x, lens.y, lens.z], axis=-1)
    around = np.concatenate([rays[0], rays[-1], rays[:, 0], rays[:, -1]])
    return around.astype(np.float64)


_MOST_TAPS = 6
_BLUR_SAMPLES = 5


@dataclass(frozen=True)
class RoverBox:
    """Box, fixed to the rover, that casts a shadow on the ground.

    `size_m` (3,): length, width and height [m]. `T_world_box` (4, 4): takes coordinates about the box's
    middle to the world's.
    """

    size_m: tuple[float, float, float]
    T_world_box: FloatArray


class Renderer:
    """Renderer of a fine terrain for a calibrated camera.

    One sweep of the terrain per azimuth gives nearly the range of every ray, one Newton step
    on the bilinear surface makes it exact, and rays beside an edge walk the surface cell by
    cell. The same arguments give the same bytes, whatever the number of threads.

    `terrain`: ground and what it is made of. `appearance`: sun, air, surface. `camera`: any lens; the world
    within 143° to the sides of the viewing direction is fast, the rest correct but slow. `seed`: of texture,
    mountains and noise. `imaging`: exposure and sensor; its lens and mounting are not used (they are the
    camera's). `wind_from_deg`: wind that shaped the finest sastrugi, clockwise from north [deg].
    `noise_seed`: of the noise, where it has a seed of its own. `surroundings`: terrain model of the ground that is seen
    around the site, instead of random mountains at the one distance of the backdrop. `ruts`: those of the rover that are
    seen; they may grow from image to image.

    The images are grey, or blue, green and red as `imaging.colour` says. Snow is matt (no forward scattering), and edges
    against the sky are smoothed by the lens's blur alone. Mountains around that hide the sun from the middle of
    the site put all of it in shade; water mirrors neither them nor clouds.

    >>> from sim.simulate.assembly import rover_camera
    >>> from sim.world.fine_terrain import fine_terrain
    >>> from sim.config.world import SceneryConfig
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> site = Dem.on(Grid((0.0, 0.0, 40.0, 40.0), 1.0), np.zeros((41, 41)))
    >>> camera = rover_camera(ImagingConfig(width=80, height=60))
    >>> renderer = Renderer(fine_terrain(site, SceneryConfig(), 1), AppearanceConfig(), camera, seed=1)
    >>> T_world_body = np.eye(4)
    >>> T_world_body[:2, 3] = 20.0, 20.0
    >>> image = renderer.render(T_world_body @ camera.T_body_camera, time_s=0.0, frame_index=0)
    >>> image.shape, image.dtype
    ((60, 80), dtype('uint8'))
    """

    def __init__(
        self,
        terrain: FineTerrain,
        appearance: AppearanceConfig,
        camera: Camera,
        seed: int,
        *,
        imaging: ImagingConfig | None = None,
        wind_from_deg: float = 235.0,
        noise_seed: int | None = None,
        surroundings: Dem | None = None,
        ruts: Ruts | None = None,
    ) -> None:
        self.terrain, self.camera = terrain, camera
        self._appearance, self._wind_from_deg, self._ruts = appearance, wind_from_deg, ruts
        self._datum = float(terrain.height.mean(dtype=np.float64))
        self._lens = lens_of(camera)
        self._edges = edge_rays(self._lens)
        self.scene = scene_of(terrain, self._datum, appearance, wind_from_deg, seed, surroundings)
        imaging = imaging or ImagingConfig()
        self._sensor = ImageSensor(imaging, camera, seed if noise_seed is None else noise_seed)
        self._ratios = np.zeros((camera.height, 2, camera.width * imaging.colour), np.float32)
        self._table = np.zeros((max(256, camera.width), max(256, int(2.4 * camera.height))), np.float32)
        self._radiance, self._depth = (np.zeros(self._lens.x.shape, np.float32) for _ in range(2))
        self._ranges = sample_ranges(float(np.hypot(*terrain.height.shape)) * terrain.step_m)
        self._no_ruts = no_ruts()
        self._far_ranges = far_ranges(self.scene.far)
        self._far_table = np.zeros(self._table.shape if surroundings else (2, 2), np.float32)

    def render(
        self,
        T_world_camera: FloatArray,
        time_s: float = 0.0,
        frame_index: int = 0,
        *,
        T_world_camera_last_row: FloatArray | None = None,
        T_world_camera_exposed: FloatArray | None = None,
        rover_box: RoverBox | None = None,
    ) -> Image:
        """Return the image of one frame: (H, W), or (H, W, 3) in colour.

        `T_world_camera` (4, 4): pose at the first row: takes camera coordinates to easting, northing,
        elevation. `time_s`: time of the frame, with which clouds drift [s].
        `T_world_camera_last_row` (4, 4): pose at the last row, for a rolling shutter.
        `T_world_camera_exposed` (4, 4): pose of the first row at the end of its exposure, for motion blur.
        """
        radiance, depth = self.trace(
            T_world_camera, T_world_camera_last_row, rover_box, shaded=True, time_s=time_s
        )
        if self._ratios.size:
            radiance = blue_green_red(radiance, self._ratios)
        if T_world_camera_exposed is not None:
            moved = self._flow(depth, T_world_camera, T_world_camera_exposed)
            radiance = _smeared(radiance, moved)
        return self._sensor.image(radiance, frame_index)

    def depth(self, T_world_camera: FloatArray, T_world_camera_last_row: FloatArray | None = None) -> Floats:
        """Return the distance along each pixel's ray (H, W) [m]; infinite for sky and the backdrop's mountains."""
        _, depth = self.trace(T_world_camera, T_world_camera_last_row, None, shaded=False)
        return np.where(depth < 0.0, np.float32(np.inf), depth)

    def flow(self, T_world_camera: FloatArray, T_world_camera_next: FloatArray) -> FloatArray:
        """Return where each pixel's place on the ground moves to (H, W, 2) [pixels]; NaN when it leaves the view.

        The backdrop moves as things at its distance do. Whether the place is hidden in the
        next image is not asked: see `visible`.
        """
        depth = self.depth(T_world_camera)
        return self._flow(
            np.where(np.isinf(depth), np.float32(-1), depth), T_world_camera, T_world_camera_next
        )

    def visible(
        self, T_world_camera: FloatArray, T_world_camera_next: FloatArray, tolerance_m: float = 0.05
    ) -> npt.NDArray[np.bool_]:
        """Return which pixels' places on the ground (H, W) are visible in the next view too."""
        depth = self.depth(T_world_camera)
        points = self._points(np.where(np.isinf(depth), np.float32(1e6), depth), T_world_camera)
        there = np.linalg.inv(T_world_camera_next)
        seen = points @ there[:3, :3].T + there[:3, 3]
        pixels = self.camera.project(seen.reshape(-1, 3)).reshape(*seen.shape[:2], 2).astype(np.float32)
        there_depth = np.nan_to_num(self.depth(T_world_camera_next), posinf=1e6)
        found = cv2.remap(there_depth, pixels[..., 0], pixels[..., 1], cv2.INTER_NEAREST, borderValue=-1.0)
        distance = np.linalg.norm(seen, axis=-1)
        return np.isfinite(depth) & (np.abs(found - distance) < tolerance_m + 0.05 * distance)

    def _points(self, depth: Floats, T_world_camera: FloatArray) -> FloatArray:
        rays = np.stack([self._lens.x, self._lens.y, self._lens.z], axis=-1).astype(np.float64)
        pose = np.asarray(T_world_camera, dtype=np.float64)
        points: FloatArray = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
        return points

    def _flow(self, depth: Floats, T_world_camera: FloatArray, T_world_camera_next: FloatArray) -> FloatArray:
        far = np.float32(self._appearance.ridges_distance_m)
        points = self._points(np.where(depth < 0.0, far, depth), T_world_camera)
        there = np.linalg.inv(T_world_camera_next)
        seen = points.reshape(-1, 3) @ there[:3, :3].T + there[:3, 3]
        v, u = np.mgrid[0 : self.camera.height, 0 : self.camera.width]
        moved: FloatArray = self.camera.project(seen).reshape(*depth.shape, 2) - np.stack([u, v], axis=-1)
        return moved

    def trace(
        self,
        first: FloatArray,
        last: FloatArray | None,
        box: RoverBox | None,
        *,
        shaded: bool,
        time_s: float = 0.0,
    ) -> tuple[Floats, Floats]:
        """Return radiance before the sensor, and depth (-1 for the backdrop), of every pixel: valid until the next call."""
        poses = [self._local(pose) for pose in ([first] if last is None else [first, last])]
        rotations, origins = _row_poses(poses, self.camera.height)
        middle = self.camera.height // 2
        directions = np.vstack([self._edges @ rotations[0].T, self._edges @ rotations[-1].T])
        view = view_of(directions, rotations[middle][:, 2], *self._table.shape)
        slopes = row_slopes(view, self._table.shape[1])
        share_out(sweep, self.scene.surface, origins[middle], view, self._ranges, slopes, self._table)
        around = self._swept_around(origins[middle], view)
        radiance, depth = self._radiance, self._depth  # fresh pages would cost a millisecond
        share_out(
            render_rows,
            self._lens,
            rotations,
            origins,
            view,
            self._table,
            around,
            self.scene,
            self._light(box, time_s),
            self._no_ruts if self._ruts is None else self._ruts.map(),
            _MOST_TAPS,
            shaded,
            radiance,
            depth,
            self._ratios,
        )
        return radiance, depth

    def _swept_around(self, eye: Doubles, view: View) -> AroundView:
        """Return the ranges of the ground around the site, as the sweep of the fine terrain gives them."""
        far, table = self.scene.far, self._far_table
        if far.reach_m > 0.0:
            view = far_view(view, table.shape[1])
            eye = eye - np.array([far.x, far.y, 0.0])
            slopes = row_slopes(view, table.shape[1])
            share_out(sweep, far.surface, eye, view, self._far_ranges, slopes, table)
        return AroundView(view, table)

    def _local(self, pose: FloatArray) -> Doubles:
        """Return a pose relative to the terrain's south-western node and datum; refuse one off the terrain or below it."""
        matrix = np.array(pose, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise InputError("the camera's pose holds no 4 × 4 finite numbers; give T_world_camera.")
        place = matrix[:3, 3]
        ground = float(self.terrain.elevation(place[None, :2])[0])
        where = f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.2f})"
        if np.isnan(ground):
            raise InputError(
                f"the camera at {where} is outside the terrain {self.terrain.bounds}; keep it on the map."
            )
        if place[2] <= ground:
            raise InputError(
                f"the camera at {where} is {ground - place[2]:.2f} m below the ground; raise it above {ground:.2f} m."
            )
        matrix[:2, 3] -= self.terrain.origin
        matrix[2, 3] -= self._datum
        return matrix

    def _light(self, box: RoverBox | None, time_s: float) -> Light:
        half, rotation, centre = np.zeros(3), np.eye(3), np.zeros(3)
        if box is not None:
            pose = np.asarray(box.T_world_box, dtype=np.float64)
            half, rotation = (
                0.5 * np.asarray(box.size_m, dtype=np.float64),
                np.ascontiguousarray(pose[:3, :3]),
            )
            centre = pose[:3, 3] - np.append(self.terrain.origin, self._datum)
        look = self._appearance
        in_shade = 0.3 + 0.7 * look.stones if self.terrain.surface == "snow" else 1.0
        bare_below = 0.5 if self.terrain.surface == "snow" and look.stones == 0.0 else 0.15
        return Light(
            sun_direction(look), look.sky_share, in_shade, look.haze_m, half, rotation, centre,
            drift_m(look, self._wind_from_deg, time_s), bare_below, self.terrain.surface == "bare ice",
        )  # fmt: skip


def _row_poses(poses: list[Doubles], n_rows: int) -> tuple[Doubles, Doubles]:
    """Return rotation and position of each row, along the shortest turn from the first pose to the last."""
    first, last = poses[0], poses[-1]
    turn = cv2.Rodrigues(first[:3, :3].T @ last[:3, :3])[0].ravel()
    share = np.linspace(0.0, 1.0, n_rows)
    origins = first[:3, 3] + share[:, None] * (last[:3, 3] - first[:3, 3])
    if not turn.any():
        return np.repeat(first[None, :3, :3], n_rows, axis=0), origins
    rotations = np.stack([first[:3, :3] @ cv2.Rodrigues(turn * s)[0] for s in share])
    return rotations, origins


def _smeared(radiance: Floats, moved: FloatArray) -> Floats:
    """Average the radiance along each pixel's motion during the exposure."""
    v, u = np.mgrid[0 : radiance.shape[0], 0 : radiance.shape[1]].astype(np.float32)
    path = np.nan_to_num(moved).astype(np.float32)
    total = np.zeros_like(radiance)
    for share in np.linspace(0.0, 1.0, _BLUR_SAMPLES, dtype=np.float32):
        x, y = u - share * path[..., 0], v - share * path[..., 1]
        total += cv2.remap(radiance, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return total / np.float32(_BLUR_SAMPLES)
