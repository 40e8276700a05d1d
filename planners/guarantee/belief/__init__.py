"""Belief about the terrain: covariances that a prior or a survey makes likely, on ground of a class of surface."""
