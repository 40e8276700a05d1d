"""Progress of Gaussian-process maps, and their expected time."""
