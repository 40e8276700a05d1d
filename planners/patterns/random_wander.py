"""Random wander: the control of the piecewise-continuous pattern, with the same steps in random directions.

The rover ignores the slope of the ground, so that a comparison shows what steering by the slope adds. The layout gives
the reference swaths of the lawnmower.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planners.patterns.lawnmower import straight_layout
from planners.patterns.planner import Planner
from planners.steering import Attitude, ConfiguredSteering, SteeredConfig, SteeringState
from survey.core import FloatArray


class RandomWanderConfig(SteeredConfig):
    """Control of the piecewise-continuous pattern: the same steps and turns, chosen at random."""

    pattern: Literal["random-wander"] = "random-wander"
    """Name of the pattern."""


@dataclass(frozen=True)
class RandomWanderSteering(ConfiguredSteering):
    """Steering by candidate headings, redrawn with `toggle_probability` at every step; nothing is sensed.

    The gain of a pattern over this one comes from its sensing; the gain of this one over
    straight swaths comes from leaving the line.

    `config`: step, candidates, switching and band.
    """

    def begin(self, swath_heading_rad: float, draws: FloatArray) -> SteeringState:
        """Return the state at the start of a swath: any candidate with equal probability.

        `draws` (N,): uniform on [0, 1), one per rover.
        """
        return SteeringState(swath_heading_rad, (len(self.config.candidates_deg) * draws).astype(np.int64))

    def steer(self, attitude: Attitude, state: SteeringState) -> FloatArray:
        """Return the next headings, whatever the attitude.

        Returns (N,): headings, counter-clockwise from east [rad].
        """
        headings: FloatArray = state.swath_heading_rad + np.radians(self.config.candidates_deg)[state.mode]
        return np.broadcast_to(headings, attitude.heading_rad.shape)

    def after_step(self, state: SteeringState, draws: FloatArray) -> SteeringState:
        """Return the state for the next step.

        `draws` (N,): uniform on [0, 1), one per rover; 1 changes nothing.
        """
        n, p = len(self.config.candidates_deg), self.config.toggle_probability
        # A draw below p is uniform on [0, p), so its share of p chooses the candidate.
        share = np.divide(draws, p, out=np.ones_like(draws), where=draws < p)
        fresh = np.minimum((n * share).astype(np.int64), n - 1)
        return state._replace(mode=np.where(draws < p, fresh, state.mode))


RANDOM_WANDER = Planner(
    RandomWanderConfig, straight_layout, steering=RandomWanderSteering, is_for_fleets=False
)
"""Entry of the registry; the layout gives the reference swaths."""
