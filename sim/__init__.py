"""Simulator of firnline: worlds, sensors and vehicles, missions, Monte Carlo studies.

Estimation and planning live in `survey`, `planners` and `vision_slam`, which never import this package.
"""
