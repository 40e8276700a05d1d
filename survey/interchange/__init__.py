"""Conversion between the survey's data types and the files of other programs.

Route exports, scan readers and dataset layouts live here; formats that know no data type live in `survey.io`.
"""
