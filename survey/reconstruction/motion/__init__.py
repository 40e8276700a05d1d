"""Surveys on moving ice.

`priors` and `stakes` give the velocity of the ice, `refinement` its update by a joint estimate, and `epoch` reduces
recordings, paths and maps to an epoch and states the age of a map.
"""
