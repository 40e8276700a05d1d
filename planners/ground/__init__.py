"""Traversability, shortest paths on free ground, and no-go masks.

Which lines it should drive is decided in `planners.swaths`.
"""
