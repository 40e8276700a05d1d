"""Rasters that do not fit the memory: averages of their cells, and other formats, window by window."""
