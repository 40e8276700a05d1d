"""Guarantees that a map meets a class with a probability, before a survey and during it.

Predicted errors without a probability live in `planners.prediction`.
"""
