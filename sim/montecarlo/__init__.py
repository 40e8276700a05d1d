"""Monte Carlo studies over random DEMs: trials, blocks, summary, report.

Studies that reproduce the papers live in `papers`.
"""
