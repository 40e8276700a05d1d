"""Coordinate reference systems and vertical datums: checks, agreement, transformation.

Refuses what is unknown or does not agree; projects nothing without being asked.
"""
