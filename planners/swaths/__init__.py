"""Swath geometry: parallel lines, decomposition of the area, heading, wavy and tie lines.

Their order and the transits between them live in `planners.routes`.
"""
