"""Simulated instruments: GPS, IMU, wheels, LiDAR and others, and their time-correlated errors.

Each is a function of motion and ground, described once in `registry`. The rover is in `sim.vehicle`, its camera in
`sim.simulate.assembly`.
"""
