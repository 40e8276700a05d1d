"""
Covariance functions
====================

Correlation against distance for one length scale, and draws of one line of terrain from each family.
"""

import numpy as np
from matplotlib import pyplot as plt

from survey.reconstruction.gp.families import kernel_of

distance_m = np.linspace(0.0, 400.0, 200)
points = np.column_stack([distance_m, np.zeros_like(distance_m)])
rng = np.random.default_rng(2)
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for shift, family in enumerate(("squared-exponential", "matern-5/2", "matern-3/2", "whittle")):
    kernel = kernel_of(family, 4.0, 80.0)
    covariance = kernel.covariance(points, points)
    left.plot(distance_m, covariance[0] / covariance[0, 0], label=family)
    draw = np.linalg.cholesky(covariance + 1e-6 * np.eye(len(points))) @ rng.normal(size=len(points))
    right.plot(distance_m, draw + 10.0 * shift, label=family)
left.set(xlabel="Distance [m]", ylabel="Correlation", title="Length scale 80 m")
right.set(xlabel="Distance [m]", ylabel="Height, shifted [m]", title="Draws")
left.legend()
