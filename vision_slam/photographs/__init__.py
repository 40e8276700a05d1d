"""Photographs far apart: features, poses of the cameras, and their place by fixes.

`matches` finds the same features in overlapping photographs, `structure` the cameras' poses, and `georeference` puts them in
the CRS of the fixes.
"""
