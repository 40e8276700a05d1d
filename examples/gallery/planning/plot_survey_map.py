"""
Survey map
==========

Relief under a hillshade, with contours, the area and the route.
"""

from firnline import sample_survey
from survey.figures import survey_map

survey = sample_survey()
survey_map(survey.terrain, area=survey.area, route=survey.route)
