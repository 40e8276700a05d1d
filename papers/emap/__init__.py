"""Figures and tables of the EMap paper.

The method itself lives in `survey.reconstruction.lattice`.
"""
