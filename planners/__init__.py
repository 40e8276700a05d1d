"""Planners of survey routes."""
