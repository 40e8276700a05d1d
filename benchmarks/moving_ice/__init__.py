"""Surveys on moving ice: maps at an epoch, velocities, mass change and feature tracking."""
