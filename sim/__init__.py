"""The simulated world, the mission and the command line."""
