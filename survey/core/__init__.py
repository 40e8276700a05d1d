"""Base layer: errors, read-only arrays, configuration, random streams, atomic files, checksums, run folders, CRS.

It does not depend on a survey's data types; code that reads one file format is in `survey.io`.
"""
