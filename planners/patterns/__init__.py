"""One module per planner: its entry for the registry, with the function that lays its route.

The computation behind an entry lives in `planners.swaths`, `planners.steering` or `planners.prediction`.
"""
