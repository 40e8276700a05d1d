"""Settings of a mission file: one model for each section, with defaults and units.

`mission` holds the file and its sections; `world`, `rover` and `sensors` hold the settings of what is simulated. The
study file of a Monte Carlo lives in `sim.montecarlo`.
"""
