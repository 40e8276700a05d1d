"""Registration of LiDAR scans by an estimated path: surface points that share the errors of the path."""
