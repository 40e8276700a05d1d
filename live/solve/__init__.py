"""Joint estimate of map and path by elimination of one stretch of the path at a time."""
