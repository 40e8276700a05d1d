"""Renderer of height fields for wide-angle cameras near the ground: images, depth, and optical flow.

The terrain that it renders is in `sim.world`, the rover's camera in `sim.instruments`.
"""

from sim.rendering.renderer import Renderer, RoverBox

__all__ = ["Renderer", "RoverBox"]
