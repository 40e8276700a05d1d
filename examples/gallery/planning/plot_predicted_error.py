"""
Predicted standard deviation
============================

The standard deviation that a route will give follows from the covariance of the terrain before anything is driven.
"""

from firnline import LawnmowerConfig, SurveyArea, plan
from planners import predict_error
from survey.figures import plan_map
from survey.reconstruction.gp.kernels import Matern52

area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_600.0, 6_700_400.0), "EPSG:32608")
route = plan(area, None, LawnmowerConfig(swaths=4))
error = predict_error(route, area, Matern52(25.0, 120.0), noise_m=0.1)

plan_map(area, route, std=error.std)
