"""Swath geometry: parallel lines, decomposition of the area and their heading.

Their order and the transits between them live in `planners.routes`.
"""
