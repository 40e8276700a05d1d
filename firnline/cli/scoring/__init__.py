"""Steps of ``firnline score``: what was asked for, scores, classes of ground, and reports."""
