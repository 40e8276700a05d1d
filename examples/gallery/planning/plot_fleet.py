"""
Three rovers
============

Three rovers share the swaths so that the last one is back as early as possible.
"""

import shapely

from firnline import Fleet, LawnmowerConfig, SurveyArea, plan
from survey.figures import plan_map

outline = shapely.box(500_000.0, 6_700_000.0, 500_600.0, 6_700_400.0)
area = SurveyArea(outline, "EPSG:32608", starts=[[500_300.0, 6_700_005.0]])
route = plan(area, None, LawnmowerConfig(swaths=9), fleet=Fleet(rovers=3))

plan_map(area, route)
