"""Benchmark of missions of several rovers, science payloads and hazard maps."""
