"""Predicted map error of a route, and the choice of patterns by it.

Statements with a probability live in `planners.guarantee`.
"""
