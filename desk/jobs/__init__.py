"""Long computations of the desk, with progress: guarantees, curves of error against swaths, missions."""
