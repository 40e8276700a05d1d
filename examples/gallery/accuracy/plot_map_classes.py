"""
Classes of the glacier paper
============================

Largest RMSE of each class against the contour interval.
"""

from matplotlib import pyplot as plt

from survey.scoring import map_classes

figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for name in ("Class 1", "Class 2", "Class 3"):
    rows = [row for row in map_classes() if row.map_class == name]
    ax.plot([row.interval_m for row in rows], [row.limit_m for row in rows], "o", label=name)
ax.set(xlabel="Contour interval [m]", ylabel="Largest RMSE [m]", xlim=(0.0, None), ylim=(0.0, None))
ax.legend()
