r"""Wavy swaths: a sine about each reference line, so that a swath also measures across its own direction.

.. math::  v(u) = A \sin(2 \pi u / \lambda')

with the distance u along the line. `wavy` winds the swaths: amplitude and length of a wave follow from the settings, the
spacing, the turning radius of the rover and the free ground. Where no wavelength is given it is in proportion to the
slope length of the terrain's covariance (`planners.prediction.slope_length_m`).
"""

from typing import Literal

import numpy as np
import shapely
from pydantic import Field, NonNegativeFloat, PositiveFloat

from planners.capacity import require_waypoints
from planners.config import SwathConfig
from planners.patterns.lawnmower import LawnmowerConfig
from planners.patterns.planner import LayoutTask, Planner
from planners.swaths.reference_lines import Swath
from survey import ConfigError, Route, SurveyArea
from survey.core import FloatArray


class WavyConfig(SwathConfig):
    """Swaths that wind about their lines, so that they also measure how the terrain changes across them.

    The defaults were chosen on random terrain of five kinds, with and without noise, other
    than the terrain on which the benchmark judges them.
    """

    pattern: Literal["wavy"] = "wavy"
    """Name of the pattern."""
    outer_share: float = Field(default=0.35, gt=0.0, le=1.0)
    """Distance of the outermost lines from the border, in spacings."""
    inset_share: NonNegativeFloat = 0.25
    """How far swaths end before the border, in spacings."""
    steepness: float = Field(default=0.6, ge=0.0, le=2.0)
    """Greatest slope of the wave against its line; 0.6 turns the rover by 31° and makes swaths 8 % longer."""
    amplitude_share: float = Field(default=0.25, ge=0.0, le=0.5)
    """Greatest distance from the line, in spacings."""
    wavelength_m: PositiveFloat | None = None
    """Length of a wave [m]; `wavelength_scales` slope lengths of the terrain when left out."""
    wavelength_scales: PositiveFloat = 0.85
    """Length of a wave in slope lengths: ℓ of a squared exponential, ℓ/√3 of a Matérn 3/2 covariance."""


LinePattern = LawnmowerConfig | WavyConfig
"""Patterns of swaths along reference lines, whose number is chosen by a predicted error."""

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

    `axes`: in boustrophedon order and direction [m]. `spacing_m`, `wavelength_m`: D and λ [m].
    `turn_radius_m`: R [m]; 0 for a rover that pivots.
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
    axis: FloatArray, amplitude_m: float, wavelength_m: float, ground: shapely.Geometry, turn_radius_m: float
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


def _wavelength_m(config: WavyConfig, slope_length_m: float | None) -> float:
    """Return the length of a wave [m]: as given, or in proportion to the slope length [m] of the terrain."""
    if config.wavelength_m is not None:
        return config.wavelength_m
    if slope_length_m is None:
        raise ConfigError("wavy swaths need a wavelength_m, or a prior or a kernel to take it from.")
    return config.wavelength_scales * slope_length_m


def _layout(config: WavyConfig, task: LayoutTask) -> Route:
    """Lay wavy swaths over the area and join them."""
    from planners.swaths.swath_route import swath_route

    wavelength_m = _wavelength_m(config, task.slope_length_m)
    radius_m = task.crew.rover.turn_radius_m

    def waves(axes: list[FloatArray], spacing_m: float) -> list[Swath]:
        return wavy(axes, task.area, config, spacing_m, wavelength_m, turn_radius_m=radius_m)

    return swath_route(task.area, config, task.crew, waves)


def _needs_kernel(config: WavyConfig) -> bool:
    """Return whether the wavelength has to be taken from the covariance."""
    return config.wavelength_m is None


WAVY = Planner(WavyConfig, _layout, needs_kernel=_needs_kernel)
"""Entry of the registry."""
