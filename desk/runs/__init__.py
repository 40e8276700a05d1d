"""Simulated runs of a plan: those that are there, their maps and errors, how they compare."""
