"""Report of a survey: one HTML page that opens offline, with its figures embedded.

Figures are drawn by `survey.figures`; scores are computed by `survey.scoring`.
"""
