"""Missions and fences of autopilots: their items on the link, upload, comparison, download."""
