"""Simulated surveys at three fidelities: ideal, statistical, and vision.

`simulation` holds the first two, `vision` the drive with physics and rendered images. Models of single instruments live
in `sim.instruments`, the rover in `sim.vehicle`.
"""
