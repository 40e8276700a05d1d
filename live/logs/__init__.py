"""Logs of autopilots as recordings."""
