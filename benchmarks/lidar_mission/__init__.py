"""Benchmark of missions with a LiDAR."""
