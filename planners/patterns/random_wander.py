"""Random wander: the control of the piecewise-continuous pattern, steered at random."""

from planners.config_random_wander import RandomWanderConfig
from planners.patterns.lawnmower import straight_layout
from planners.patterns.planner import Planner
from planners.steering.random_wander import RandomWanderSteering

RANDOM_WANDER = Planner(
    RandomWanderConfig, straight_layout, steering=RandomWanderSteering, is_for_fleets=False
)
"""Entry of the registry; the layout gives the reference swaths."""
