"""Files: checked reading, atomic writing and atomic replacement of folders and of groups of files.

An interrupted writer leaves what stood in its place before.
"""
