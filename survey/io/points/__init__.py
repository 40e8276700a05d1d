"""Point files: CSV, GeoPackage, LAS, LAZ and PLY, as named columns of numbers.

Every format has a reader and a writer of one table of points.
"""
