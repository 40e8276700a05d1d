"""Camera calibration from images of a chessboard or a ChArUco board.

The entry point is `vision_slam.calibration.calibrate.calibrate`.
"""
