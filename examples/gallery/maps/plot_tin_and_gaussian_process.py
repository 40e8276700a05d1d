"""
Triangles and a Gaussian process
================================

The same samples of four swaths, interpolated linearly in triangles and by a Gaussian process.
"""

from matplotlib import pyplot as plt

from firnline import reconstruct, sample_survey

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
triangles = reconstruct(survey.points, survey.grid, method="tin", area=survey.area)

figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for ax, title, result in ((axes[0], "Triangles", triangles), (axes[1], "Gaussian process", mapped)):
    result.plot(ax=ax)
    ax.set_title(title)
