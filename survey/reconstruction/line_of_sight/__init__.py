"""Lines of sight and scans: the ground is nowhere above a ray that reached its end.

Begin with `ceiling`, the lowest rays over every node; `returns` selects the returns and rays of a scan that are fit for it,
and rejects isolated points below the ground of a point cloud. `scan_points` places the returns of scans
along an estimated path, and takes surface points from them.
"""
