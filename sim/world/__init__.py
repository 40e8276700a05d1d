"""Simulated site: terrain, fine relief, hazards and surface appearance.

Images of it are rendered in `sim.rendering`.
"""
