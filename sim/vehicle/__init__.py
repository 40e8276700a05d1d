"""Simulated rover: motion, rigid-body and kinematic physics, and path following.

Sensors are in `sim.instruments`.
"""
