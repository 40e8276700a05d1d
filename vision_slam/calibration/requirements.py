"""Requirements on the views of a calibration: number, coverage of the image, tilt."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from vision_slam.calibration.boards import BoardView

LEAST_VIEWS = 8
LEAST_COVERAGE = 0.5
_CELLS = 6
_LEAST_TILT_DEG, _LEAST_TILTED = 12.0, 3
_LARGEST_FOCAL_SHARE = 0.02


def coverage(views: Sequence[BoardView], size: tuple[int, int]) -> float:
    """Return the share of the image area, in cells of a sixth of its sides, that corners have reached.

    Examples
    --------
    >>> corners = np.array([[10.0, 10.0], [590.0, 390.0]])
    >>> round(coverage([BoardView(corners, corners)], (600, 400)), 3)
    0.056
    """
    return float(_reached(views, size).mean())


def _reached(views: Sequence[BoardView], size: tuple[int, int]) -> FloatArray:
    """Return which cells (6, 6) of the image, from the upper left one, hold corners."""
    cells = np.zeros((_CELLS, _CELLS))
    for view in views:
        at = np.clip((view.pixels + 0.5) / size * _CELLS, 0, _CELLS - 1).astype(int)
        cells[at[:, 1], at[:, 0]] = 1.0
    return cells


def tilts_deg(poses: FloatArray) -> FloatArray:
    """Return by how much each board is tilted out of the image plane, about its x and y axes (N, 2) [deg]."""
    normals = Rotation.from_rotvec(poses[:, :3]).as_matrix()[:, :, 2]
    normals = normals * np.sign(normals[:, 2:])
    angles: FloatArray = np.degrees(np.arctan2(normals[:, :2], normals[:, 2:]))
    return angles


def refuse_few(n_views: int, n_images: int, rejected: Sequence[str]) -> None:
    """Refuse fewer than eight views of the board.

    Raises
    ------
    InputError
        Counts what was found, and names the first rejected images.
    """
    if n_views < LEAST_VIEWS:
        named = f" ({'; '.join(rejected[:3])}{' …' if len(rejected) > 3 else ''})" if rejected else ""
        raise InputError(
            f"the board was found in {n_views} of {n_images} images{named}; at least {LEAST_VIEWS} views were expected: check "
            "the number of corners, and take sharp images of the complete board."
        )


def refuse_one_sided(views: Sequence[BoardView], poses: FloatArray, size: tuple[int, int]) -> None:
    """Refuse views that leave half of the image out, or that all face the board.

    Raises
    ------
    InputError
        Names what is missing.
    """
    cells = _reached(views, size)
    if cells.mean() < LEAST_COVERAGE:
        raise InputError(
            f"the board has reached {100.0 * cells.mean():.0f} % of the image area, and least in the {_emptiest(cells)}; move it "
            f"through all of the image, at least {100.0 * LEAST_COVERAGE:.0f} %."
        )
    tilted = np.abs(tilts_deg(poses)) > _LEAST_TILT_DEG
    if tilted.any(axis=1).sum() < _LEAST_TILTED:
        raise InputError(
            f"{tilted.any(axis=1).sum()} of {len(views)} views are tilted by more than {_LEAST_TILT_DEG:.0f}°, so that focal "
            f"length and distance cannot be separated; tilt the board by 20 to 45° in at least {_LEAST_TILTED} views."
        )


def refuse_uncertain(parameters: FloatArray, sigma: FloatArray) -> None:
    """Refuse a focal length with a standard deviation above 2 %.

    Raises
    ------
    InputError
        States the standard deviation.
    """
    share = float((sigma[:2] / parameters[:2]).max())
    if not share <= _LARGEST_FOCAL_SHARE:
        raise InputError(
            f"the views determine the focal length to {100.0 * share:.1f} % alone, {100.0 * _LARGEST_FOCAL_SHARE:.0f} % "
            "were expected; add views that are tilted in other directions, nearer, and in the corners of the image."
        )


def _emptiest(cells: FloatArray) -> str:
    """Return the quarter of the image with the fewest cells that were reached."""
    half = _CELLS // 2
    quarters = {
        "upper left": cells[:half, :half],
        "upper right": cells[:half, half:],
        "lower left": cells[half:, :half],
        "lower right": cells[half:, half:],
    }
    return min(quarters, key=lambda name: float(quarters[name].mean()))
