"""Benchmark of maps in tiles: made surveys with known strip errors, real strips, peers, workers and kills.

Development used seeds 1 to 9; seeds 101 to 103 are judged.
"""
