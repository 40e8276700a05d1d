"""Wavy swaths: a sine about each line, so that a swath also measures across its own direction."""

import numpy as np
import shapely

from planners.capacity import require_waypoints
from planners.config_wavy import WavyConfig
from planners.swaths.swaths import Swath
from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea

_POINTS_PER_WAVE = 16
_MOST_HALVINGS = 5


def wavy(
    axes: list[FloatArray],
    area: SurveyArea,
    config: WavyConfig,
    spacing_m: float,
    wavelength_m: float,
    *,
    turn_radius_m: float = 0.0,
) -> list[Swath]:
    r"""Wind a swath about every axis.

    .. math::  v(u) = A \sin(2 \pi u / \lambda'), \qquad A = \min(s \lambda / 2 \pi, \; a D), \qquad
               \lambda' = 2 \ell / \mathrm{round}(2 \ell / \lambda)

    with the distance u along an axis of length ℓ, so that swaths begin and end on their
    axis; s is the `steepness`, a the `amplitude_share` and D the spacing. A rover of turning
    radius R gets waves of ``A <= λ² / (4 π² R)``, whose crests it can follow. Where the full
    wave would leave the free ground its amplitude is halved until it does not, and the swath
    is straight when five halvings are not enough.

    Parameters
    ----------
    axes : list of (2, 2) ndarray
        In boustrophedon order and direction [m].
    area : SurveyArea
        The free ground.
    config : WavyConfig
        The shape.
    spacing_m, wavelength_m : float
        D and λ [m].
    turn_radius_m : float
        R [m]; 0 for a rover that pivots.
    """
    total_m = float(sum(np.hypot(*(axis[1] - axis[0])) for axis in axes))
    require_waypoints(_POINTS_PER_WAVE * total_m / wavelength_m, "the wavelength", wavelength_m)
    ground = area.free.buffer(1e-6)
    shapely.prepare(ground)
    amplitude_m = min(config.steepness * wavelength_m / (2.0 * np.pi), config.amplitude_share * spacing_m)
    first = axes[0][1] - axes[0][0]
    swaths = []
    for axis in axes:
        # Waves are laid in the direction of the first swath, so that neighbours run side by side.
        is_back = float((axis[1] - axis[0]) @ first) < 0.0
        forth = axis[::-1] if is_back else axis
        xy = _wave(forth, amplitude_m, wavelength_m, ground, turn_radius_m)
        swaths.append(Swath(xy[::-1] if is_back else xy, axis))
    return swaths


def _wave(
    axis: FloatArray,
    amplitude_m: float,
    wavelength_m: float,
    ground: shapely.Geometry,
    turn_radius_m: float,
) -> FloatArray:
    along = axis[1] - axis[0]
    length = float(np.hypot(*along))
    n_half_waves = max(round(2.0 * length / wavelength_m), 1)
    # A piece shorter than half a wave, as in the corners of a slanted sweep, bends only as much as its share.
    amplitude_m *= min(1.0, 2.0 * length / wavelength_m)
    if turn_radius_m > 0.0:
        amplitude_m = min(amplitude_m, (length / (np.pi * n_half_waves)) ** 2 / turn_radius_m)
    share = np.linspace(0.0, 1.0, n_half_waves * (_POINTS_PER_WAVE // 2) + 1)
    left = np.array([-along[1], along[0]]) / length
    for halving in range(_MOST_HALVINGS):
        offset = 0.5**halving * amplitude_m * np.sin(np.pi * n_half_waves * share)
        xy = axis[0] + share[:, None] * along + offset[:, None] * left
        xy[0], xy[-1] = axis
        if amplitude_m != 0.0 and ground.covers(shapely.linestrings(xy)):
            wave: FloatArray = xy
            return wave
    return axis
