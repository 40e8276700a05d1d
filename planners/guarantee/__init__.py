"""Guarantees that a map meets a class with a probability, before a survey and during it.

Errors are predicted by `planners.prediction`.
"""
