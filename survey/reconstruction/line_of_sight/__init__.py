"""Bounds on the terrain from lines of sight: the ground is nowhere above a ray that reached its end.

Begin with `ceiling`, the lowest rays over every node; `sight_lines` selects the rays that are fit for
it, `ground` finds which returns are ground under what overhangs it, and `steep_ground` finds slopes from the upper bound alone.
"""
