"""Simulated LiDAR: rays that meet the real terrain, and returns with noise, dropouts, ghosts and spray."""
