"""Figures and tables of the space-carving paper.

The method itself lives in `survey.reconstruction.carving`.
"""
