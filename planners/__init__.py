"""Planners of survey routes."""

from planners.config import LawnmowerConfig, PlannerConfig
from planners.planning import plan

__all__ = ["LawnmowerConfig", "PlannerConfig", "plan"]
