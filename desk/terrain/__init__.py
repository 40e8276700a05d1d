"""Terrain on the map of the desk: elevations at every resolution, coloured tiles."""
