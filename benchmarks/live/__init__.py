"""Missions over lossy links, kills, malformed telemetry, updates of the live map, and the closed loop."""
