"""The mission file: every section as a model with defaults and units.

The study file of a Monte Carlo lives in `sim.montecarlo`.
"""
