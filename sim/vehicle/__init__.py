"""The simulated rover: rigid-body and kinematic motion, and path following.

What it senses lives in `sim.instruments`.
"""
