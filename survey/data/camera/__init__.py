"""Calibrated camera and images of a drive.

Images are read one at a time, and written while the next is computed.
"""
