"""Rehearsal of missions: many runs with other seeds and drawn settings, and a fault tree of those that fail."""
