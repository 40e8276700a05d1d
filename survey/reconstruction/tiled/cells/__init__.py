"""Points of a large survey sorted to tiles on disk, and their statistics in cells."""
