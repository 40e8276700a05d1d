"""A mission from plan to report: stages, run folders, report page, template.

Simulation of the drive lives in `sim.simulate`.
"""
