"""Map classes promised with a probability, before a survey and during it.

Predicted errors without a probability live in `planners.prediction`.
"""
