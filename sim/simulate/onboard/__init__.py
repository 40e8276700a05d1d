"""Computer on board of a simulated rover: navigator, its process, and the monitor that ends a drive.

The simulation of the drive itself stands in `sim.simulate.vision`.
"""
