"""Simulated surveys at three fidelities: ideal, statistical, and vision.

Models of single instruments live in `sim.instruments`, the rover in `sim.vehicle`.
"""
