"""Checks of a map that need no reference: held-out points, and the posterior of the map's error."""
