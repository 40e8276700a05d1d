"""Drivable routes: free ground, shortest paths, turns, and the order of swaths for one rover or a fleet.

Nothing here depends on the map that the survey will give. Swaths are laid in `planners.swaths`.
"""
