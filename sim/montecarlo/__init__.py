"""Monte Carlo studies over random DEMs: study file, trials, results.

Studies that reproduce the papers live in `papers`.
"""
