"""Checks of gyro and mounting of the camera against the motion that the images themselves show."""
