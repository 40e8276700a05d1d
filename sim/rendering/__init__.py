"""Renderer of height fields for wide-angle cameras near the ground: images, depth, and optical flow.

`visibility` finds where the rays meet the ground, `footprint` samples the textures, `light` gives the radiance, and
`renderer` makes the image. The terrain is in `sim.world`, the rover's camera in `sim.simulate`.
"""

from sim.rendering.renderer import Renderer, RoverBox
from sim.rendering.ruts import Ruts

__all__ = ["Renderer", "RoverBox", "Ruts"]
