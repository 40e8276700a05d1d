"""Point files: text tables, vector files, LAS, LAZ and PLY, as named columns of numbers.

Every format has a reader and a writer of one table of points.
"""
