"""A mission from plan to report: mission file, run folder, stages.

Read `stages` first: each stage reads files and writes files. Simulation of the drive lives in `sim.simulate`.
"""
