"""
Cover and standard deviation of a LiDAR survey
==============================================

A LiDAR on a mast sees the ground between swaths that are far apart. One return of each visit stands for a cell of
ground; the map shares the error of the path between them.
"""

from firnline import (
    BeamErrors,
    LidarConfig,
    SensorConfig,
    localize,
    reconstruct,
    sample_survey,
    scan_points,
    simulate,
)
from survey.figures import deviation_map, landmark_map

survey = sample_survey(swaths=2)
sensors = SensorConfig(lidar=LidarConfig(beams=32, rate_hz=0.25, columns=180, height_m=1.8))
recording, truth = simulate(survey.terrain, survey.route, sensors=sensors)
path = localize(recording).trajectory
points = scan_points(recording.lidar, path, BeamErrors.of(recording.lidar.scanner))
mapped = reconstruct(points, survey.grid, path=path.error, method="joint")

cover = landmark_map(points, mapped.mean, area=survey.area, route=survey.route, name="Scan points")
sigma = deviation_map(mapped, area=survey.area, route=survey.route)
