"""Piecewise-continuous pattern: steered by the slope of the ground (glacier paper, Eq. 10)."""

from planners.config_piecewise_continuous import PiecewiseContinuousConfig
from planners.patterns.lawnmower import straight_layout
from planners.patterns.planner import Planner
from planners.steering.piecewise_continuous import PiecewiseContinuousSteering

PIECEWISE_CONTINUOUS = Planner(
    PiecewiseContinuousConfig, straight_layout, steering=PiecewiseContinuousSteering, is_for_fleets=False
)
"""Entry of the registry; the layout gives the reference swaths."""
