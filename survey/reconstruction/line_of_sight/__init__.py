"""Bounds on the terrain from lines of sight: the ground is nowhere above a ray that reached its end.

Begin with `ceiling`, the lowest rays over every node; `returns` selects the returns and rays of a scan that are fit for it,
and `low_returns` rejects isolated points below the ground of a point cloud.
"""
