"""Modes of ``firnline plan``: a route for an area, for a required map class, or for a mission.

The planners are in `planners`; here are only options, checks, printed text and written files.
"""
