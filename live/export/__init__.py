"""Runs as MCAP files for Foxglove and rerun."""
