"""Run folders of missions and their manifests with checksums.

A stage's folder is complete and unchanged, or it is made again.
"""
