"""Figures of tracked corners on images, of features that photographs share, and of a map that images extend."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from survey import Camera, InputError
from survey.core import FloatArray
from survey.data.frames import Frames, Image
from survey.figures.style import DEVIATION, ESTIMATE, FULL_IN, INK, styled
from vision_slam.attitude import initial_pose
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import MotionSensors
from vision_slam.odometry.tracks import ContrastEnhancer, grey_of
from vision_slam.odometry.visual_slam import VisualSlam
from vision_slam.orthoimage import Orthoimage
from vision_slam.photographs.matches import detect_features, epipolar_error_px, match_features
from vision_slam.readers.sequence import VisionRecords

if TYPE_CHECKING:
    from vision_slam.extended_map import ExtendedMap  # loads scipy.stats

_N_FOLLOWED = 10  # images over which corners are followed
_N_DRAWN = 6  # of each corner's places, so that lines stay apart
_YOUNG = "#f0e442"
_N_PAIRS, _N_FEATURES = 4, 150  # pairs of photographs of which one is drawn, and its features


@styled
def tracks_on_frames(
    drive: VisionRecords, config: VisualOdometryConfig | None = None, n_places: int = 2
) -> Figure:
    """Draw the corners that visual odometry tracks over ten images, at a few places of a drive.

    Visual odometry starts at each place, once with the original images (left) and once after
    CLAHE (right), with the same settings otherwise. A line is the latest track of an inlier, the
    dot its last pixel. Near corners have a triangulated distance; the others, on the horizon,
    give rotation only.
    """
    if drive.frames is None or drive.camera is None:
        raise InputError("the drive has no images; tracks on frames need some.")
    settings = config or VisualOdometryConfig()
    plain = settings.model_copy(update={"clahe_clip": 0.0})
    n, camera = len(drive.frames), drive.camera
    n_each = min(_N_FOLLOWED, n)
    ends = np.unique(np.linspace(n_each - 1, n - 1, n_places + 2)[1:-1].astype(int)).tolist()
    height_in = len(ends) * (0.5 * FULL_IN * camera.height / camera.width + 0.3)
    figure = Figure(figsize=(FULL_IN, height_in), layout="constrained")
    panels = figure.subplots(len(ends), 2, squeeze=False)
    for row, last in zip(panels, ends, strict=True):
        grey = grey_of(drive.frames[last], camera.width, camera.height)
        for axes, used, name in zip(row, (plain, settings), ("As it came", "After CLAHE"), strict=True):
            ways, n_near = tracked_pixels(
                drive, drive.frames, camera, range(last - n_each + 1, last + 1), used
            )
            _draw(axes, ContrastEnhancer(used.clahe_clip, used.clahe_tiles)(grey), ways)
            axes.set_title(f"{name}: {len(ways)} corners followed, {n_near} of them near", fontsize=9)
        row[0].set_ylabel(f"{drive.frames.time_s[last] - drive.frames.time_s[0]:.1f} s")
    return figure


def tracked_pixels(
    drive: VisionRecords, frames: Frames, camera: Camera, chosen: range, config: VisualOdometryConfig
) -> tuple[list[FloatArray], int]:
    """Return the latest pixels (K, 2) of each corner tracked into the last of the chosen frames, and how many are near."""
    times, sensors = frames.time_s, MotionSensors(drive)
    slam = VisualSlam(camera, config, initial_pose(drive, times[chosen[0]]))
    for index in chosen:
        motion = None if index == chosen[0] else sensors.between(times[index - 1], times[index])
        slam.step(frames[index], times[index], motion)
    tracks = [track for track in slam.live_tracks if len(track.rays) > 1]
    ways = [
        np.vstack([camera.project(np.array(track.rays[-_N_DRAWN:])), track.pixel[None]]) for track in tracks
    ]
    return ways, sum(track.is_near for track in tracks)


def _draw(axes: Axes, image: Image, ways: list[FloatArray]) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="antialiased")
    for colour, width in (("black", 1.6), (_YOUNG, 0.8)):
        axes.add_collection(LineCollection(ways, colors=colour, linewidths=width))
    ends = np.array([way[-1] for way in ways]).reshape(-1, 2)
    axes.plot(*ends.T, "o", color=ESTIMATE, markersize=2.6, markeredgecolor="white", markeredgewidth=0.3)
    axes.set(xlim=(-0.5, image.shape[1] - 0.5), ylim=(image.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


@styled
def features_on_photographs(frames: Frames) -> Figure:
    """Draw two photographs, one taken after the other, with features that both show, in the same colours.

    Of a few pairs along the series that with most features is drawn.
    """
    pairs = np.unique(np.linspace(0, len(frames) - 2, _N_PAIRS).astype(int)).tolist()
    found = {first: _shared_pixels(frames, first) for first in pairs}
    first = max(pairs, key=lambda index: len(found[index][0]))
    height, width = frames[first].shape[:2]
    figure = Figure(figsize=(FULL_IN, 0.5 * FULL_IN * height / width + 0.3), layout="constrained")
    chosen = np.unique(np.linspace(0, len(found[first][0]) - 1, _N_FEATURES).astype(int))
    colour = found[first][0][chosen, 0]
    titles = f"Image {first + 1}: {len(found[first][0])} features", f"Found again in image {first + 2}"
    for axes, index, pixel, title in zip(
        figure.subplots(1, 2), (first, first + 1), found[first], titles, strict=True
    ):
        axes.imshow(grey_of(frames[index], width, height), cmap="gray", vmin=0, vmax=255)
        axes.scatter(*pixel[chosen].T, c=colour, cmap="viridis", s=9, edgecolors="white", linewidths=0.3)
        axes.set_title(title, fontsize=9)
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
    return figure


def _shared_pixels(frames: Frames, first: int) -> tuple[FloatArray, FloatArray]:
    """Return where a photograph and the next one show the same features, (M, 2) each [pixels], from left to right."""
    before, after = (detect_features(frames[index]) for index in (first, first + 1))
    shared = match_features(before, after, epipolar_error_px(frames[first]))
    shared = shared[np.argsort(before.pixel[shared[:, 0], 0])]
    return before.pixel[shared[:, 0]], after.pixel[shared[:, 1]]


_LINES_M = (0.5, 1.0, 2.0, 5.0, 10.0)


@styled
def extended_map(found: "ExtendedMap", image: Orthoimage, path: FloatArray) -> Figure:
    """Draw the orthoimage with contours, heights and contradictions, and the standard deviation with and without images.

    `path` (N, 2): the way of the drive [m].
    """
    figure = Figure(figsize=(FULL_IN, 0.42 * FULL_IN), layout="constrained")
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    with_images, alone = found.reconstruction, found.scans_alone
    west, south, east, north = with_images.mean.bounds
    extent = (west, east, south, north)
    bands = np.nan_to_num(np.moveaxis(image.bands, 0, 2), nan=255.0) / 255.0
    axes[0].imshow(np.broadcast_to(bands, (*bands.shape[:2], 3)), extent=extent)
    heights = with_images.mean.elevation
    relief = float(np.nanmax(heights) - np.nanmin(heights))
    step = next((one for one in _LINES_M if relief / one < 12), _LINES_M[-1])
    levels = np.arange(np.floor(np.nanmin(heights) / step), np.nanmax(heights) / step) * step
    axes[0].contour(with_images.mean.x, with_images.mean.y, heights, levels, colors=INK, linewidths=0.4)
    axes[0].set_title(f"Orthoimage, contours {step:g} m", fontsize=9)
    limit = float(np.nanpercentile(alone.std.elevation, 95))
    for panel, made, name in zip(axes[1:], (alone, with_images), ("Scans alone", "With images"), strict=True):
        drawn = panel.imshow(made.std.elevation, extent=extent, cmap=DEVIATION, vmin=0.0, vmax=limit)
        panel.contour(made.mean.x, made.mean.y, found.is_scanned, [0.5], colors=INK, linewidths=0.7)
        panel.set_title(f"{name}, standard deviation", fontsize=9)
    axes[2].plot(*found.heights.xyz[:, :2].T, ".", color=INK, markersize=0.8)
    for panel in axes:
        panel.plot(*path.T, color=ESTIMATE, linewidth=1.2)
        panel.set_aspect("equal")
        panel.set_xticks([])
        panel.set_yticks([])
    for number, one in enumerate(found.contradictions, start=1):
        axes[0].plot(*one.xy, "x", color=ESTIMATE)
        axes[0].annotate(
            str(number), one.xy, xytext=(3, 3), textcoords="offset points", fontsize=7, color=ESTIMATE
        )
    figure.colorbar(drawn, ax=axes[1:].tolist(), label="m", shrink=0.8)
    return figure
