"""Simulated site: terrain and prior, moving ice, fine relief with hazards, and surface appearance.

Images of it are rendered in `sim.rendering`.
"""
