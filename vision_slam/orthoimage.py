"""Orthoimage of the ground from the images of a drive, its estimated path and a map of the ground."""

from typing import NamedTuple

import cv2
import numpy as np

from survey.core import BoolArray, FloatArray, IntArray
from survey.data import Dem, Grid, Trajectory
from survey.data.camera import Camera
from survey.data.frames import Frames
from vision_slam.ground_heights import CameraPoses

_CLEAR_M = 0.1  # above the line of sight that ground may reach
_N_ON_SIGHT = 48
_BORDER_PX = 2.0
_NEAREST_M = 2.0  # nearer lies the vehicle itself


class Orthoimage(NamedTuple):
    """Colours of the ground on a grid: bands (B, H, W) of 0 to 255, NaN where no image sees it; one band is grey, three are red, green and blue."""

    bands: FloatArray
    grid: Grid

    @property
    def named(self) -> dict[str, FloatArray]:
        """Bands by name."""
        names = ("grey",) if len(self.bands) == 1 else ("red", "green", "blue")
        return dict(zip(names, self.bands, strict=True))

    @property
    def seen_share(self) -> float:
        """Share of the grid that an image sees."""
        return float(np.isfinite(self.bands[0]).mean())


def orthoimage(
    frames: Frames,
    camera: Camera,
    path: Trajectory,
    surface: Dem,
    grid: Grid,
    *,
    spacing_m: float = 2.0,
    farthest_m: float = 45.0,
) -> Orthoimage:
    """Project the images of a drive onto the ground.

    Each cell is the mean of the images that see it, weighted with the fourth power of the nearness times the sine of the grazing
    angle, so that the sharpest view dominates and seams are soft. Ground hidden behind other ground of the map is left out.

    Parameters
    ----------
    frames : Frames
        Images.
    camera : Camera
        Calibration and mounting.
    path : Trajectory
        Estimated path; images whose pose is lost are not used.
    surface : Dem
        Map of the ground, in the CRS of the path.
    grid : Grid
        Cells of the orthoimage.
    spacing_m : float
        Way between images that are used [m].
    farthest_m : float
        Ground beyond that distance from an image is left out [m].

    Returns
    -------
    Orthoimage
        Grey or colour, as the images are.

    Notes
    -----
    Brightness is that of the images: light that depends on the direction of view, and exposures that change, leave seams.
    """
    poses = CameraPoses.of(path, frames.time_s, camera)
    xyz = np.column_stack([grid.xy, np.asarray(surface.at(grid.xy))])
    total, weight = np.zeros((len(xyz), 1)), np.zeros(len(xyz))
    for one in poses.every(spacing_m):
        image = np.atleast_3d(frames[int(poses.image[one])])[:, :, ::-1].astype(np.float32)
        seen = _seen(xyz, (poses.place[one], poses.turn[one]), camera, surface, farthest_m)
        if not len(seen.cells):
            continue
        column, row = seen.pixel.astype(np.float32).T.copy()
        values = cv2.remap(np.ascontiguousarray(image), column[:, None], row[:, None], cv2.INTER_LINEAR)
        total = np.broadcast_to(total, (len(xyz), image.shape[2])).copy()
        total[seen.cells] += seen.weight[:, None] * values.reshape(len(seen.cells), -1)
        weight[seen.cells] += seen.weight
    with np.errstate(invalid="ignore"):
        mean = np.where(weight[:, None] > 0.0, total / weight[:, None], np.nan)
    return Orthoimage(mean.T.reshape(-1, *grid.shape), grid)


class _Seen(NamedTuple):
    """Numbers (M,) of cells that an image sees, their pixels (M, 2) and weights (M,)."""

    cells: IntArray
    pixel: FloatArray
    weight: FloatArray


def _seen(
    xyz: FloatArray, pose: tuple[FloatArray, FloatArray], camera: Camera, surface: Dem, farthest_m: float
) -> _Seen:
    """Return the cells that one image sees; its pose is its place and R_world_camera."""
    place, turn = pose
    offset = xyz - place
    range_m = np.linalg.norm(offset, axis=1)
    cells = np.flatnonzero((range_m > _NEAREST_M) & (range_m < farthest_m))
    pixel = camera.project(offset[cells] @ turn)
    with np.errstate(invalid="ignore"):
        inside = (pixel >= _BORDER_PX).all(axis=1) & (
            pixel <= [camera.width - 1 - _BORDER_PX, camera.height - 1 - _BORDER_PX]
        ).all(axis=1)
    cells, pixel = cells[inside], pixel[inside]
    clear = _is_clear(place, xyz[cells], surface)
    cells, pixel = cells[clear], pixel[clear]
    grazing = np.maximum(-offset[cells, 2] / range_m[cells], 0.01)
    return _Seen(cells, pixel, grazing / range_m[cells] ** 4)


def _is_clear(place: FloatArray, xyz: FloatArray, surface: Dem) -> BoolArray:
    """Return which places (N, 3) no ground hides from a place."""
    clear = np.isfinite(xyz[:, 2])
    for share in np.linspace(0.1, 0.97, _N_ON_SIGHT):
        on = place + share * (xyz - place)
        clear &= ~(surface.at(on[:, :2]) > on[:, 2] + _CLEAR_M)
    return clear
