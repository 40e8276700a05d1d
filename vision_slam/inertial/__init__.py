"""Motion and attitude from gyro, accelerometer, compass and wheels.

Images are not used here.
"""
