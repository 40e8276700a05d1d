"""Parts of data types: roles of the features of an area, columns of the files of surface points.

The types themselves stand in `survey.data.area` and `survey.data.surface_points`.
"""
