"""Simulated instruments: camera, GPS, IMU, wheels, LiDAR, and their time-correlated errors.

Each is a function of motion and ground, described once in `registry`; the rover itself is in `sim.vehicle`.
"""
