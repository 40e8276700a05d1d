"""LiDAR scans of a drive: geometry of the scanner, and the returns of each turn."""
