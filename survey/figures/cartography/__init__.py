"""Parts of maps: layout, relief, contours, outlines, routes, scale bar and north arrow.

They draw into given axes; whole figures stand beside this folder.
"""
