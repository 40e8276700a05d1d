"""Covariance functions of the terrain and their spectra.

Choosing a function and its hyperparameters is the task of `survey.reconstruction.gp.selection`.
"""
