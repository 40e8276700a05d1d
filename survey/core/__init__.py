"""Base layer: errors, read-only arrays, configuration, random streams, atomic files, checksums, run folders, CRS.

Nothing here knows a survey's data types; code that reads one file format lives in `survey.io`.
"""
