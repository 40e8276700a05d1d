r"""Heights of the ground from the images of a drive, by plane sweep with estimated poses.

`heights_from_images` takes a reference image every few metres of the way. Patches of it that look at ground within reach are
compared with images taken before and after, for a series of distances along their rays; each patch is a plane with the local
slope of a map that is known before, such as that of scans and landmarks. The distance of the highest mean correlation c is refined
by a parabola. Its inverse ρ has the standard deviation

.. math:: \sigma_\rho^2 = \frac{2 (1 - c)}{V N (-c'')}

of V views and N independent pixels, because :math:`2 (1 - c)` is the squared difference of two patches of unit norm.

A height is retained where two halves of the views agree, where no other distance correlates nearly as well, and where a second
reference image confirms it. The error that all heights from one pose share, that of the pose, is carried by the keyframe of the points.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt
from scipy.spatial import cKDTree

from survey.core import BoolArray, FloatArray, InputError, IntArray, Progress, Section
from survey.data import Dem, SurfacePoints, Trajectory
from survey.data.camera import Camera
from survey.data.frames import Frames, Image
from survey.reconstruction.line_of_sight.scan_points import PathInterpolator, covariance_by_pose
from vision_slam.odometry.tracks import ContrastEnhancer, grey_of
from vision_slam.plane_sweep import Patches, Sweep, Views, sweep_patches


class ImageHeightsConfig(Section):
    """How heights are taken from images.

    Examples
    --------
    >>> ImageHeightsConfig(farthest_m=30.0).spacing_m
    2.0
    """

    spacing_m: PositiveFloat = 2.0
    """Way between reference images [m]."""
    baselines_m: tuple[PositiveFloat, ...] = (1.0, 2.5, 5.0)
    """Way from a reference image to the views that it is compared with, ahead and behind [m]."""
    nearest_m: PositiveFloat = 9.0
    """Ground nearer than that is left to scans and landmarks [m]."""
    farthest_m: PositiveFloat = 45.0
    """Ground beyond that is left out [m]."""
    pixel_step: tuple[PositiveInt, PositiveInt] = (20, 3)
    """Columns and rows between patches [pixels]; at grazing angles rows are far apart on the ground."""
    half_patch: tuple[PositiveInt, PositiveInt] = (5, 4)
    """Columns and rows of a patch on each side of its middle [pixels]."""
    least_correlation: float = Field(default=0.6, gt=0.0, lt=1.0)
    """Mean correlation that a patch needs."""
    most_sigma_m: PositiveFloat = 0.4
    """Largest standard deviation of a height by the images alone [m]."""
    cell_m: PositiveFloat = 1.2
    """Side of the cells of ground that are represented by one height [m]."""


_PIXEL_STEP_PX = 0.75  # between distances, in the view with the longest baseline
_SHORTEST, _LONGEST = 0.55, 1.9  # of the expected distance, that are tried
_MOST_STEPS = 240
_INDEPENDENT_SHARE = 0.25  # of the pixels of a patch: images are blurred
_RIVAL_STEPS, _RIVAL_SHARE = 6, 0.94
_AGREE_SIGMAS, _AGREE_STEPS = 3.0, 1.5
_ACROSS_PX = 0.5
_MARCH_M = 0.25
_LEAST_VIEWS = 2
_SAME_M, _MOSTLY = (
    0.12,
    0.6,
)  # difference of heights that confirm each other, and share of the neighbours that do


class RectifiedImages:
    """Images of a drive with even contrast, as a pinhole camera without distortion would show them.

    `frames`: the images. `camera`: calibration of the lens.
    """

    def __init__(self, frames: Frames, camera: Camera) -> None:
        self._frames, self._even = frames, ContrastEnhancer(4.0, 8)
        self._size = camera.width, camera.height
        focal = 0.5 * float(camera.matrix[0, 0] + camera.matrix[1, 1])
        corners = camera.rays(_border(camera.width, camera.height))
        reach = np.nanmax(np.abs(corners[:, :2] / np.maximum(corners[:, 2:], 0.2)), axis=0)
        half = np.ceil(focal * np.minimum(reach, 2.0)).astype(int)
        self.width, self.height = (2 * half + 1).tolist()
        self.focal, self.cx, self.cy = focal, float(half[0]), float(half[1])
        column, row = np.meshgrid(np.arange(self.width), np.arange(self.height))
        rays = self.rays(np.column_stack([column.ravel(), row.ravel()]))
        maps = camera.project(rays).reshape(self.height, self.width, 2).astype(np.float32)
        self._columns, self._rows = np.moveaxis(np.nan_to_num(maps, nan=-1e3), 2, 0).copy()
        inside = (
            (maps >= 1.0).all(axis=2) & (maps[..., 0] < camera.width - 2) & (maps[..., 1] < camera.height - 2)
        )
        self.is_inside: BoolArray = inside
        self._kept: dict[int, Views] = {}

    @property
    def lens(self) -> tuple[float, float, float]:
        """Focal length and principal point [pixels]."""
        return self.focal, self.cx, self.cy

    def rays(self, pixel: FloatArray | IntArray) -> FloatArray:
        """Return the directions (N, 3) of pixels (N, 2), with depth 1."""
        plane = (pixel - np.array([self.cx, self.cy])) / self.focal
        return np.column_stack([plane, np.ones(len(plane))])

    def grey(self, index: int) -> Views:
        """Return one image without its lens distortion, in its own grey values."""
        return self._rectified(grey_of(self._frames[index], *self._size))

    def __getitem__(self, index: int) -> Views:
        if index not in self._kept:
            even = self._even(grey_of(self._frames[index], *self._size))
            self._kept[index] = self._rectified(even)
        return self._kept[index]

    def _rectified(self, image: Image) -> Views:
        seen = cv2.remap(image, self._columns, self._rows, cv2.INTER_LINEAR)
        return np.asarray(seen, dtype=np.float32)

    def forget_before(self, index: int) -> None:
        """Free the memory of images before one."""
        self._kept = {k: image for k, image in self._kept.items() if k >= index}


def _border(width: int, height: int) -> FloatArray:
    """Return pixels along the border of an image."""
    x, y = np.linspace(0.0, width - 1.0, 20), np.linspace(0.0, height - 1.0, 20)
    sides = [(x, 0 * x), (x, 0 * x + height - 1), (0 * y, y), (0 * y + width - 1, y)]
    return np.vstack([np.column_stack(side) for side in sides])


class CameraPoses(NamedTuple):
    """Numbers (K,) of the images that a path places, their times [s], places (K, 3) [m] and turns R_world_camera (K, 3, 3), poses of the body, and way [m]."""

    image: IntArray
    time_s: FloatArray
    place: FloatArray
    turn: FloatArray
    body: FloatArray
    body_turn: FloatArray
    travel_m: FloatArray

    @classmethod
    def of(cls, path: Trajectory, time_s: FloatArray, camera: Camera) -> "CameraPoses":
        """Return the poses of the images with times (N,) [s] that the path covers and whose pose is not lost."""
        healthy = np.interp(time_s, path.time_s, np.asarray(path.health)) >= 0.5
        image = np.flatnonzero((time_s >= path.time_s[0]) & (time_s <= path.time_s[-1]) & healthy)
        if len(image) < 1 + _LEAST_VIEWS:
            raise InputError(
                f"the path covers the times of {len(image)} images, and three or more are needed; give images and path of one drive."
            )
        at, mount = PathInterpolator(path).at(time_s[image]), camera.T_body_camera
        place = at.position + at.rotation @ mount[:3, 3]
        steps = np.linalg.norm(np.diff(at.position, axis=0), axis=1)
        turn, travel_m = at.rotation @ mount[:3, :3], np.r_[0.0, np.cumsum(steps)]
        return cls(image, time_s[image], place, turn, at.position, at.rotation, travel_m)

    def every(self, spacing_m: float) -> list[int]:
        """Return the first pose of each stretch of the way."""
        stretch = np.floor(self.travel_m / spacing_m)
        return np.flatnonzero(np.r_[True, np.diff(stretch) > 0]).tolist()


class _Sighting(NamedTuple):
    """Ground seen from one reference image: rays (N, 3) with depth 1 in the world, inverse depths, and their quality."""

    image: IntArray
    ray: FloatArray
    inverse_depth: FloatArray
    sigma: FloatArray
    correlation: FloatArray
    rival: FloatArray
    brightness: FloatArray


def heights_from_images(
    frames: Frames,
    camera: Camera,
    path: Trajectory,
    surface: Dem,
    config: ImageHeightsConfig | None = None,
    *,
    progress: Progress | None = None,
) -> SurfacePoints:
    """Return heights of the ground that the images of a drive show.

    Parameters
    ----------
    frames : Frames
        Images of the drive.
    camera : Camera
        Calibration and mounting; the rows of the image are taken at one time.
    path : Trajectory
        Estimated path; images that it does not cover or whose pose is lost are left out.
    surface : Dem
        Map of the ground that is known before, in the CRS of the path, which says where and how inclined patches are expected.
    config : ImageHeightsConfig, optional
        Spacing, reach and gates.
    progress : callable, optional
        Progress callback (stage, done, total).

    Returns
    -------
    SurfacePoints
        One for each cell of ground, with keyframes where the path has its error. The values are the mean correlation, that of the next peak as
        a share of it (``rival``), the grey value over the image's median (``brightness``), the number of the reference (``image``) and its time.

    Raises
    ------
    InputError
        Fewer than three images on the path, or no ground that two reference images confirm.

    Notes
    -----
    Ground straight ahead has little parallax and gets few heights. Distances from 0.55 to 1.9 times the expected one are tried.
    """
    config = config or ImageHeightsConfig()
    images, poses = RectifiedImages(frames, camera), CameraPoses.of(path, frames.time_s, camera)
    ground, found = _Ground(surface), list[_Sighting]()
    references = poses.every(config.spacing_m)
    for done, reference in enumerate(references, start=1):
        sighting = _seen_from(reference, images, poses, ground, config)
        if sighting is not None:
            found.append(sighting)
        if progress is not None:
            progress("images", done, len(references))
    if not found:
        raise InputError("no image shows ground within reach; give more images, or a prior of the ground.")
    joined = _Sighting(*(np.concatenate(columns) for columns in zip(*found, strict=True)))
    points = _as_points(joined, path, poses, images.focal, config)
    return replace(points, vertical_datum=surface.vertical_datum)


class _Ground:
    """Expected ground: where rays meet it, and its normals."""

    def __init__(self, surface: Dem) -> None:
        self._surface = surface
        to_east, to_north = surface.gradient()
        self._slopes = [Dem.on(surface.grid(), one) for one in (to_east, to_north)]

    def met_by(self, place: FloatArray, ray: FloatArray, farthest_m: float) -> FloatArray:
        """Return where rays (N, 3) first meet the ground, in lengths of the ray; NaN where they do not."""
        length = np.linalg.norm(ray, axis=1)
        away = np.arange(1.0, farthest_m, _MARCH_M)
        met, above = np.full(len(ray), np.nan), np.zeros(len(ray))
        for metres in away:
            at = place + ray * (metres / length)[:, None]
            gap = at[:, 2] - self._surface.at(at[:, :2])
            hit = np.isnan(met) & (gap <= 0.0)
            share = above / np.maximum(above - gap, 1e-9)
            met = np.where(hit, (metres - _MARCH_M * (1.0 - share)) / length, met)
            above = np.where(np.isfinite(gap), gap, above)
        return met

    def normals(self, xy: FloatArray) -> FloatArray:
        """Return the normals (N, 3) at places (N, 2)."""
        to_east, to_north = (np.nan_to_num(slope.at(xy)) for slope in self._slopes)
        return np.column_stack([-to_east, -to_north, np.ones(len(xy))])


def _views_of(reference: int, travel_m: FloatArray, baselines_m: tuple[float, ...]) -> IntArray:
    """Return the images at the baselines ahead and behind, in order."""
    wanted = travel_m[reference] + np.array([*(-b for b in baselines_m[::-1]), *baselines_m])
    wanted = wanted[(wanted >= travel_m[0] - 1e-6) & (wanted <= travel_m[-1] + 1e-6)]
    nearest = np.abs(travel_m[:, None] - wanted).argmin(axis=0)
    return np.unique(nearest[nearest != reference])


def _seen_from(
    reference: int,
    images: RectifiedImages,
    poses: CameraPoses,
    ground: _Ground,
    config: ImageHeightsConfig,
) -> _Sighting | None:
    """Return the ground that a reference image and its views show."""
    views = _views_of(reference, poses.travel_m, config.baselines_m)
    if len(views) < _LEAST_VIEWS:
        return None
    images.forget_before(int(poses.image[views.min()]))
    pixel, depth, normal = _expected(reference, images, poses, ground, config)
    if not len(pixel):
        return None
    turn = np.einsum("vji,jk->vik", poses.turn[views], poses.turn[reference])
    shift = np.einsum("vji,vj->vi", poses.turn[views], poses.place[reference] - poses.place[views])
    longest = float(np.linalg.norm(shift, axis=1).max())
    step = np.full(len(pixel), _PIXEL_STEP_PX / (images.focal * longest))
    first = 1.0 / (_LONGEST * depth)
    n_steps = int(min(_MOST_STEPS, np.ceil((1.0 / (_SHORTEST * depth) - first).max() / step[0])))
    step = np.maximum(step, (1.0 / (_SHORTEST * depth) - first) / n_steps)
    stack = np.stack([images[int(poses.image[view])] for view in views])
    half = config.half_patch
    patches, sweep = Patches(pixel, normal, first, step), Sweep(n_steps, *images.lens, *half)
    curves = sweep_patches(images[int(poses.image[reference])], stack, patches, (turn, shift), sweep)
    best = _peaks(curves, first, step, config)
    ray = images.rays(pixel[best.which]) @ poses.turn[reference].T
    image = np.full(len(ray), reference)
    brightness = _brightness(images.grey(int(poses.image[reference])), pixel, half)[best.which]
    return _Sighting(image, ray, best.inverse_depth, best.sigma, best.correlation, best.rival, brightness)


def _brightness(grey: Views, pixel: IntArray, half: tuple[int, int]) -> FloatArray:
    """Return the mean grey value of patches (N,) over the median of all of them."""
    mean = cv2.blur(grey, (2 * half[0] + 1, 2 * half[1] + 1))[pixel[:, 1], pixel[:, 0]]
    return np.asarray(mean / max(float(np.median(mean)), 1.0), dtype=np.float64)


def _expected(
    reference: int, images: RectifiedImages, poses: CameraPoses, ground: _Ground, config: ImageHeightsConfig
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return pixels (N, 2) that look at ground within reach, its expected depth (N,) and normals (N, 3) in the camera's frame."""
    (across, down), step = config.half_patch, config.pixel_step
    column, row = np.meshgrid(
        np.arange(across, images.width - across, step[0]), np.arange(down, images.height - down, step[1])
    )
    pixel = np.column_stack([column.ravel(), row.ravel()]).astype(np.int64)
    pixel = pixel[images.is_inside[pixel[:, 1], pixel[:, 0]]]
    ray = images.rays(pixel) @ poses.turn[reference].T
    depth = ground.met_by(poses.place[reference], ray, config.farthest_m)
    range_m = depth * np.linalg.norm(ray, axis=1)
    near = np.isfinite(depth) & (range_m >= config.nearest_m)
    pixel, depth, ray = pixel[near], depth[near], ray[near]
    normal = ground.normals((poses.place[reference] + ray * depth[:, None])[:, :2])
    return pixel, depth, np.ascontiguousarray(normal @ poses.turn[reference])


class _Peaks(NamedTuple):
    """Peaks of correlation: which patches have one, inverse depths [1/m], standard deviations, correlations, and those of the next peak as a share."""

    which: IntArray
    inverse_depth: FloatArray
    sigma: FloatArray
    correlation: FloatArray
    rival: FloatArray


def _peaks(curves: Views, first: FloatArray, step: FloatArray, config: ImageHeightsConfig) -> _Peaks:
    """Return the peaks of the mean correlation on which both halves of the views agree and that have no rival."""
    n_views = np.isfinite(curves).sum(axis=1)
    mean = _mean(curves, _LEAST_VIEWS)
    index = np.argmax(np.where(np.isfinite(mean), mean, -1.0), axis=1)
    n_steps, row = mean.shape[1], np.arange(len(mean))
    inner = (index >= 1) & (index < n_steps - 1)
    index = np.clip(index, 1, n_steps - 2)
    offset, height, bend = _parabola(mean, row, index)
    away = np.abs(np.arange(n_steps) - index[:, None]) > _RIVAL_STEPS
    rival = np.where(away & np.isfinite(mean), mean, -1.0).max(axis=1)
    pixels = (2 * config.half_patch[0] + 1) * (2 * config.half_patch[1] + 1) * _INDEPENDENT_SHARE
    with np.errstate(all="ignore"):
        spread = np.sqrt(2.0 * (1.0 - height) / (n_views[row, index] * pixels * bend))
    halves = [_half_peak(curves[:, k::2], index) for k in (0, 1)]
    apart = np.abs(halves[0] - halves[1])
    agree = apart <= _AGREE_STEPS + _AGREE_SIGMAS * 2.0 * spread
    good = (
        inner & agree & (height >= config.least_correlation) & (rival <= _RIVAL_SHARE * height) & (bend > 0.0)
    )
    which = np.flatnonzero(good & np.isfinite(spread))
    rho = first[which] + (index[which] + offset[which]) * step[which]
    return _Peaks(which, rho, spread[which] * step[which], height[which], (rival / height)[which])


def _mean(curves: Views, least: int) -> FloatArray:
    """Return the mean (N, S) of the curves of views (N, V, S); NaN where fewer than the least are known."""
    known = np.isfinite(curves)
    count = known.sum(axis=1)
    total = np.where(known, curves, 0.0).sum(axis=1, dtype=np.float64)
    return np.where(count >= least, total / np.maximum(count, 1), np.nan)


def _parabola(curve: FloatArray, row: IntArray, index: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return offset, height and negative second derivative of the parabola through three neighbours, per step."""
    before, here, after = (curve[row, index + k] for k in (-1, 0, 1))
    bend = 2.0 * here - before - after
    with np.errstate(all="ignore"):
        offset = np.clip(0.5 * (after - before) / bend, -0.5, 0.5)
    return offset, here + 0.25 * (after - before) * offset, bend


_NEAR_STEPS = 8


def _half_peak(curves: Views, index: IntArray) -> FloatArray:
    """Return where the mean of some views peaks about a place (N,); NaN where they see nothing there."""
    mean = _mean(curves, 1)
    steps = np.clip(index[:, None] + np.arange(-_NEAR_STEPS, _NEAR_STEPS + 1), 1, mean.shape[1] - 2)
    row = np.arange(len(mean))
    near = np.take_along_axis(mean, steps, axis=1)
    best = steps[row, np.argmax(np.where(np.isfinite(near), near, -1.0), axis=1)]
    offset, height, _ = _parabola(mean, row, best)
    return np.where(np.isfinite(height), best + offset, np.nan)


def _as_points(
    seen: _Sighting, path: Trajectory, poses: CameraPoses, focal: float, config: ImageHeightsConfig
) -> SurfacePoints:
    """Return the points with their covariances and keyframes, one for each cell that two references confirm."""
    xyz = poses.place[seen.image] + seen.ray / seen.inverse_depth[:, None]
    along = seen.ray * (seen.sigma / seen.inverse_depth**2)[:, None]
    across = _ACROSS_PX / focal / seen.inverse_depth
    own = along[:, :, None] * along[:, None, :] + (across**2)[:, None, None] * np.eye(3)
    sigma_z = np.sqrt(own[:, 2, 2])
    chosen = np.flatnonzero(sigma_z <= config.most_sigma_m)
    chosen = chosen[_confirmed(xyz[chosen], sigma_z[chosen], seen.image[chosen], config.cell_m)]
    if not len(chosen):
        raise InputError(
            "no ground is confirmed by two reference images; give images that are closer to each other."
        )
    xyz, own, image = xyz[chosen], own[chosen], seen.image[chosen]
    rotation, body = poses.body_turn[image], poses.body[image]
    keyframe = None if path.error is None else path.error.keyframe_at(poses.time_s[image])
    if path.error is None or keyframe is None:
        nearest = np.searchsorted(path.time_s, poses.time_s[image]).clip(max=len(path) - 1)
        shared = path.covariance[nearest]
    else:
        shared = covariance_by_pose(xyz - body, rotation, path.error.pose_covariance(keyframe))
    return SurfacePoints(
        xyz,
        covariance=own + shared,
        origins=poses.place[image],
        body=body,
        range_m=np.linalg.norm(xyz - poses.place[image], axis=1),
        values={
            "correlation": seen.correlation[chosen],
            "rival": seen.rival[chosen],
            "brightness": seen.brightness[chosen],
            "image": image.astype(np.float64),
            "time_s": poses.time_s[image],
        },
        crs=path.crs,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]),
    )


def _confirmed(xyz: FloatArray, sigma_z: FloatArray, image: IntArray, cell_m: float) -> IntArray:
    """Return the most certain point of each cell whose height most of those of other references, within a cell, confirm."""
    order = np.argsort(sigma_z, kind="stable")
    tree = cKDTree(xyz[:, :2])
    taken: set[tuple[int, int]] = set()
    chosen = []
    for index in order.tolist():
        cell = tuple(np.floor(xyz[index, :2] / cell_m).astype(int).tolist())
        if cell in taken:
            continue
        near = np.array(tree.query_ball_point(xyz[index, :2], cell_m))
        other = near[image[near] != image[index]]
        gap = np.abs(xyz[other, 2] - xyz[index, 2])
        agree = gap <= _SAME_M + 3.0 * np.hypot(sigma_z[other], sigma_z[index])
        if agree.sum() >= max(1.0, _MOSTLY * len(other)):
            taken.add(cell)
            chosen.append(index)
    return np.array(sorted(chosen), dtype=np.int64)
