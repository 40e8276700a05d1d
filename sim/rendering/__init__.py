"""A fast, exact renderer of height fields for wide-angle cameras near the ground."""

from sim.rendering.renderer import Renderer, RoverBox

__all__ = ["Renderer", "RoverBox"]
