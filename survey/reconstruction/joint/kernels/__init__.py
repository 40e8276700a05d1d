"""Kernels of the joint map: residuals that they are fitted to, and their choice."""
