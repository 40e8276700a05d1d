"""Options of ``firnline localize``, checked before any work. The estimator is in `vision_slam`."""
