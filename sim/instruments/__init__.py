"""Simulated instruments: camera, GPS, IMU, wheels, LiDAR, and their time-correlated errors.

Each is a function of motion and ground; what carries them lives in `sim.vehicle`.
"""
