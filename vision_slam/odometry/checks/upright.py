"""Check of the mounting: the side of the camera on which the ground lies."""

import numpy as np

from survey.core.arrays import FloatArray

_LEAST_LANDMARKS, _ROUNDS = 200, 10
_EXPLAINED = 0.3  # share of the scatter of inverse distances that a plane must explain
_ACROSS, _OTHER_SIDE = (
    0.6,
    -0.5,
)  # share of the normal across the optical axis; cosine to where the ground is mounted
_HIGHEST = 0.15  # sine of the elevation of the optical axis above which a ceiling is looked at


def mounting_note(offset: FloatArray, T_body_camera: FloatArray) -> str | None:
    r"""Return a note where the plane of the landmarks lies above a camera that does not look up.

    Points x = r d of a plane have inverse distances that are linear in the direction d,

    .. math:: 1 / r = n \cdot d

    with n towards the plane. Of a camera that is mounted upside down n points up. Among walls no plane explains the distances,
    and nothing is said.

    Parameters
    ----------
    offset : (N, 3) ndarray
        Landmarks relative to the camera, in axes of the body and in any unit.
    T_body_camera : (4, 4) ndarray
        Mounting.

    Returns
    -------
    str or None
        One sentence.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> ground = np.column_stack([rng.uniform(2.0, 5.0, 300), rng.uniform(-2.0, 2.0, 300), np.full(300, -1.0)])
    >>> level = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    >>> mounting_note(ground, level)
    >>> mounting_note(ground * [1.0, 1.0, -1.0], level)
    'the ground lies above the camera by 300 landmarks: ...'
    """
    axis = T_body_camera[:3, 2]
    if len(offset) < _LEAST_LANDMARKS or axis[2] > _HIGHEST:
        return None
    normal, explained = _plane(offset)
    across = normal - axis * (normal @ axis)
    down = np.array([0.0, 0.0, -1.0]) + axis * axis[2]
    size = float(np.linalg.norm(across))
    if explained < _EXPLAINED or size < _ACROSS * np.linalg.norm(normal):
        return None
    if across @ down > _OTHER_SIDE * size * np.linalg.norm(down):
        return None
    return (
        f"the ground lies above the camera by {len(offset)} landmarks: it seems to be mounted upside down, and T_body_camera "
        "says otherwise; correct it, or turn the images"
    )


def _plane(offset: FloatArray) -> tuple[FloatArray, float]:
    """Return the normal (3,) over the distance of the plane, and the share of inverse distances explained, of least absolute sums."""
    inverse = 1.0 / np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    direction = offset * inverse[:, None]
    weight = np.ones(len(inverse))
    for _ in range(_ROUNDS):
        normal = np.linalg.lstsq(weight[:, None] * direction, weight * inverse, rcond=None)[0]
        residual = np.abs(direction @ normal - inverse)
        weight = np.maximum(residual, 1e-3 * np.median(inverse)) ** -0.5
    scatter = float(np.abs(inverse - np.median(inverse)).sum())
    return normal, 1.0 - float(residual.sum()) / max(scatter, 1e-12)
