"""Benchmark of maps in tiles: made surveys with known strip errors, real strips, peers, workers, kills, large rasters.

Development used seeds 1 to 9; seeds 101 to 103 are judged. The level of one small survey is one draw of the errors of its
strips and control points, so that its coverage is taken over several surveys; that of 25 km² has a dozen strips. Other
programs: GDAL's gdal_grid; PDAL and verde are not installed where this was written.
"""
