"""One module per planner: its configuration, the function that lays its route, and its entry for the registry."""
