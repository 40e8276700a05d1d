"""
Predicted error against swaths
==============================

Rough terrain needs more swaths than smooth terrain of the same relief and length scale.
"""

from matplotlib import pyplot as plt

from firnline import LawnmowerConfig, SurveyArea, plan
from planners import predict_error
from survey.reconstruction.gp.families import kernel_of

area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_400.0, 6_700_400.0), "EPSG:32608")
numbers = range(2, 9)
routes = [plan(area, None, LawnmowerConfig(swaths=n)) for n in numbers]

figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for family in ("squared-exponential", "matern-5/2", "matern-3/2"):
    kernel = kernel_of(family, 25.0, 120.0)
    ax.semilogy(
        numbers,
        [predict_error(route, area, kernel, noise_m=0.1).rmse_m for route in routes],
        "o-",
        label=family,
    )
ax.axhline(0.4572, color="black", linestyle="--", label="Class 3")
ax.set(xlabel="Swaths", ylabel="Predicted RMSE [m]")
ax.legend()
