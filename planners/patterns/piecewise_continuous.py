"""Piecewise-continuous pattern: steered by the slope of the ground (glacier paper, Eq. 10).

At each step the rover takes the heading of steepest ascent, or of steepest descent, among candidates about its swath;
a random number switches between the two. The layout gives the reference swaths of the lawnmower, and
`planners.steered_paths` computes the path while it is driven.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planners.patterns.lawnmower import straight_layout
from planners.patterns.planner import Planner
from planners.steering import Attitude, ConfiguredSteering, SteeredConfig, SteeringState
from survey.core import FloatArray


class PiecewiseContinuousConfig(SteeredConfig):
    """The glacier paper's second pattern (Eq. 10): steepest ascent or descent about a swath, switched at random.

    The paper leaves step, candidates, switching and bounds open; these are the values
    read into it. The route is made while driving: see `planners.steering`.
    """

    pattern: Literal["piecewise-continuous"] = "piecewise-continuous"
    """Name of the pattern."""


@dataclass(frozen=True)
class PiecewiseContinuousSteering(ConfiguredSteering):
    r"""Steering by steepest ascent or descent among a few headings, switched at random.

    .. math::  h = \arg\max_{c} \; g \cdot e_{c} \;\; (\mathrm{flag} = 1), \qquad
               h = \arg\min_{c} \; g \cdot e_{c} \;\; (\mathrm{flag} = 0)

    over the candidate headings c, with the gradient g of the plane that the rover stands
    on and the unit vector e_c. The flag is drawn at every swath and flips with
    `toggle_probability` at every step. On level ground the rover follows the swath.

    `config`: step, candidates, switching and band.

    The paper prints the minimum and maximum of a vector and leaves step, candidates,
    switching and bounds open; this is one reading. Steered by
    the slopes of another terrain it needs the same distance within 6 %
    (``benchmarks.planning_patterns``): the gain comes from leaving the line, not from the slope.

    >>> from planners import PiecewiseContinuousConfig
    >>> steering = PiecewiseContinuousSteering(PiecewiseContinuousConfig(swaths=2))
    >>> left_side_up = Attitude(np.array([0.1]), np.zeros(1), np.zeros(1))
    >>> [np.degrees(steering.steer(left_side_up, SteeringState(0.0, np.array([flag])))) for flag in (0, 1)]
    [array([-45.]), array([45.])]
    """

    def begin(self, swath_heading_rad: float, draws: FloatArray) -> SteeringState:
        """Return the state at the start of a swath: either rule with equal probability.

        `draws` (N,): uniform on [0, 1), one per rover.
        """
        return SteeringState(swath_heading_rad, (draws < 0.5).astype(np.int64))

    def steer(self, attitude: Attitude, state: SteeringState) -> FloatArray:
        """Return the next headings.

        Returns (N,): headings, counter-clockwise from east [rad].
        """
        # The least turn first, so that it wins on level ground.
        candidates = np.radians(sorted(self.config.candidates_deg, key=abs))
        headings = state.swath_heading_rad + candidates
        slope = attitude.slope_along(headings[:, None])
        best = np.where(state.mode == 1, slope.argmax(axis=0), slope.argmin(axis=0))
        chosen: FloatArray = headings[best]
        return chosen

    def after_step(self, state: SteeringState, draws: FloatArray) -> SteeringState:
        """Return the state for the next step: the flag flips with the probability of the configuration.

        `draws` (N,): uniform on [0, 1), one per rover; 1 changes nothing.
        """
        flips = draws < self.config.toggle_probability
        return state._replace(mode=np.where(flips, 1 - state.mode, state.mode))


PIECEWISE_CONTINUOUS = Planner(
    PiecewiseContinuousConfig, straight_layout, steering=PiecewiseContinuousSteering, is_for_fleets=False
)
"""Entry of the registry; the layout gives the reference swaths."""
