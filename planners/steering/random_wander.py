"""The control of the piecewise-continuous pattern: a rover that wanders blindly by the same steps."""

from dataclasses import dataclass

import numpy as np

from planners.steering.steering import Attitude, ConfiguredSteering, SteeringState
from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class RandomWanderSteering(ConfiguredSteering):
    """One of the candidate headings, drawn anew with `toggle_probability` at every step; nothing is sensed.

    What a pattern gains over this one is due to its sensing; what this one gains over
    straight swaths is due to leaving the line.
    """

    def begin(self, swath_heading_rad: float, draws: FloatArray) -> SteeringState:
        """Return the state at the start of a swath: any candidate with equal chance."""
        return SteeringState(swath_heading_rad, (len(self.config.candidates_deg) * draws).astype(np.int64))

    def steer(self, attitude: Attitude, state: SteeringState) -> FloatArray:
        """Return the next heading (N,) [rad], whatever the attitude."""
        headings: FloatArray = state.swath_heading_rad + np.radians(self.config.candidates_deg)[state.mode]
        return np.broadcast_to(headings, attitude.heading_rad.shape)

    def after_step(self, state: SteeringState, draws: FloatArray) -> SteeringState:
        """Return the state for the next step."""
        n, p = len(self.config.candidates_deg), self.config.toggle_probability
        # A draw below p is uniform on [0, p), so its share of p chooses the candidate.
        share = np.divide(draws, p, out=np.ones_like(draws), where=draws < p)
        fresh = np.minimum((n * share).astype(np.int64), n - 1)
        return state._replace(mode=np.where(draws < p, fresh, state.mode))
