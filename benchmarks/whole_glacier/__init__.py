"""Benchmark of maps in tiles: made surveys with known strip errors, real strips, peers, workers, kills, large rasters.

Development used seeds 1 to 9 and 1001 to 1060; seeds 101 to 103 are judged, and 201 to 240 for the coverage of small
surveys. The level of one small survey is one draw of the errors of its strips and control points, so that coverage is
taken over forty of them; that of 25 km² has a dozen strips. Other programs: GDAL's gdal_grid, and verde where
``FIRNLINE_VERDE`` names a Python in which it is installed. PDAL could not be installed where this was written.
"""
