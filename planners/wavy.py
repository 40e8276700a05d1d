"""Wavy swaths: a sine about each line, so that a swath also measures across its own direction."""

import numpy as np
import shapely

from planners.config import WavyConfig
from planners.swaths import Swath
from survey.area import SurveyArea
from survey.arrays import FloatArray

_POINTS_PER_WAVE = 16
_MOST_HALVINGS = 5


def wavy(
    axes: list[FloatArray], area: SurveyArea, config: WavyConfig, spacing_m: float, wavelength_m: float
) -> list[Swath]:
    r"""Wind a swath about every axis.

    .. math::  v(u) = \pm a D \sin(2 \pi u / \lambda'), \qquad \lambda' = 2 \ell / \mathrm{round}(2 \ell / \lambda)

    with the distance u along an axis of length ℓ, so that swaths begin and end on their
    axis. Where the full wave would leave the free ground its amplitude is halved until
    it does not, and the swath is straight when five halvings are not enough.

    Parameters
    ----------
    axes : list of (2, 2) ndarray
        In boustrophedon order and direction [m].
    area : SurveyArea
        The free ground.
    config : WavyConfig
        The shape; ``a`` is its `amplitude_share`.
    spacing_m, wavelength_m : float
        D and λ [m].
    """
    ground = area.free.buffer(1e-6)
    shapely.prepare(ground)
    swaths = []
    for index, axis in enumerate(axes):
        # Axes are driven to and fro, so equal signs in the driver's frame would be opposite on the ground.
        sign = -1.0 if index % 2 == 1 and not config.is_mirrored else 1.0
        swaths.append(_wave(axis, sign * config.amplitude_share * spacing_m, wavelength_m, ground))
    return swaths


def _wave(axis: FloatArray, amplitude_m: float, wavelength_m: float, ground: shapely.Geometry) -> Swath:
    along = axis[1] - axis[0]
    length = float(np.hypot(*along))
    n_half_waves = max(round(2.0 * length / wavelength_m), 1)
    share = np.linspace(0.0, 1.0, n_half_waves * (_POINTS_PER_WAVE // 2) + 1)
    left = np.array([-along[1], along[0]]) / length
    for halving in range(_MOST_HALVINGS):
        offset = 0.5**halving * amplitude_m * np.sin(np.pi * n_half_waves * share)
        xy = axis[0] + share[:, None] * along + offset[:, None] * left
        xy[0], xy[-1] = axis
        if amplitude_m != 0.0 and ground.covers(shapely.linestrings(xy)):
            return Swath(xy, axis)
    return Swath(axis, axis)
