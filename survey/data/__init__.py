"""Data types of a survey: area, DEM, grid, route, recording, camera, trajectory, surface points.

Types check and hold values; estimation, planning and file formats of other programs live elsewhere.
"""
