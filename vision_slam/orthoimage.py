"""Orthoimage of the ground from the images of a drive, its estimated path and a map of the ground."""

from typing import NamedTuple

import cv2
import numpy as np

from survey.core import BoolArray, FloatArray
from survey.data import Dem, Grid, Trajectory
from survey.data.camera import Camera
from survey.data.frames import Frames
from vision_slam.ground_heights import CameraPoses, trusted_images

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
    usable = trusted_images(frames.time_s, path)
    poses = CameraPoses.of(path, frames.time_s[usable], camera)
    xyz = np.column_stack([grid.xy, surface.at(grid.xy)])
    total, weight = None, np.zeros(len(xyz))
    stretch = np.floor(poses.travel_m / spacing_m)
    for one in np.flatnonzero(np.r_[True, np.diff(stretch) > 0]).tolist():
        image = np.atleast_3d(frames[int(usable[one])])[:, :, ::-1].astype(np.float32)
        total = np.zeros((len(xyz), image.shape[2])) if total is None else total
        cells, pixel, share = _seen(xyz, poses.place[one], poses.turn[one], camera, surface, farthest_m)
        if len(cells):
            seen = cv2.remap(np.ascontiguousarray(image), pixel[:, None].astype(np.float32), None, cv2.INTER_LINEAR)
            total[cells] += share[:, None] * seen.reshape(len(cells), -1)
            weight[cells] += share
    assert total is not None
    with np.errstate(invalid="ignore"):
        mean = np.where(weight[:, None] > 0.0, total / weight[:, None], np.nan)
    return Orthoimage(mean.T.reshape(-1, *grid.shape), grid)


def _seen(
    xyz: FloatArray, place: FloatArray, turn: FloatArray, camera: Camera, surface: Dem, farthest_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the cells (M,) that one image sees, their pixels (M, 2) and weights (M,)."""
    offset = xyz - place
    range_m = np.linalg.norm(offset, axis=1)
    cells = np.flatnonzero((range_m > _NEAREST_M) & (range_m < farthest_m))
    pixel = camera.project(offset[cells] @ turn)
    with np.errstate(invalid="ignore"):
        inside = (pixel >= _BORDER_PX).all(axis=1) & (pixel <= [camera.width - 1 - _BORDER_PX, camera.height - 1 - _BORDER_PX]).all(axis=1)
    cells, pixel = cells[inside], pixel[inside]
    clear = _is_clear(place, xyz[cells], surface)
    cells, pixel = cells[clear], pixel[clear]
    grazing = np.maximum(-offset[cells, 2] / range_m[cells], 0.01)
    return cells, pixel, grazing / range_m[cells] ** 4


def _is_clear(place: FloatArray, xyz: FloatArray, surface: Dem) -> BoolArray:
    """Return which places (N, 3) no ground hides from a place."""
    clear = np.isfinite(xyz[:, 2])
    for share in np.linspace(0.1, 0.97, _N_ON_SIGHT):
        on = place + share * (xyz - place)
        clear &= ~(surface.at(on[:, :2]) > on[:, 2] + _CLEAR_M)
    return clear
