# %% [markdown]
# # How many swaths
#
# How many swaths does a map of Class 3 (RMSE 0.4572 m) take? There are two answers. A Monte Carlo study counts how many
# surveys of random terrain reach the class. A guarantee is stated for *your* site before the drive: the fewest swaths
# whose map meets the class with a probability of 90 %. On the command line:
#
# ```shell
# firnline montecarlo study.toml
# firnline plan site.gpkg --prior srtm.tif --require class-3 --probability 0.9 --surface snow
# ```

# %%
import csv
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from firnline import Grid, SurveyArea
from planners.guarantee.guarantee import guarantee
from planners.guarantee.requirement import MapRequirement
from sim.montecarlo.config import read_study
from sim.montecarlo.study import run_study
from survey.figures import plan_map
from survey.terrain import matern_field

# %% [markdown]
# ## A study over random terrain
#
# A study file names kinds of terrain, planners, numbers of swaths and the number of trials. Ten terrains of 300 × 300 m
# are enough to see the shape of the curve; a study for a decision takes a hundred.

# %%
STUDY = """
schema_version = 1
name = "how-many"
seed = 2012
trials = 10
require = "class-3"
swaths = [1, 2, 3, 4, 5]

[[terrains]]
name = "smooth, 120 m"
source = "random"
family = "squared-exponential"
length_scale_m = 120.0
size_m = 300.0
relief_m = 20.0

[[planners]]
pattern = "lawnmower"

[[planners]]
pattern = "wavy"
"""
Path("study.toml").write_text(STUDY, encoding="utf-8")
page = run_study(read_study(Path("study.toml")), Path("how-many"), engine="serial")
with Path("how-many/summary.csv").open(encoding="utf-8", newline="") as file:
    rows = list(csv.DictReader(file))

# %%
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for planner in ("lawnmower", "wavy"):
    curve = [row for row in rows if row["planner"] == planner]
    swaths = [int(row["swaths"]) for row in curve]
    ax.plot(swaths, [float(row["mean_rmse_m"]) for row in curve], "o-", label=planner)
ax.axhline(0.4572, color="black", linestyle="--", label="Class 3")
ax.set(xlabel="Swaths", ylabel="Mean RMSE [m]", yscale="log", xticks=swaths)
_ = ax.legend()

# %% [markdown]
# The page `how-many/index.html` has the same curves, the tables are `trials.csv` and `summary.csv`. Every trial is stored
# when it finishes, so the same call continues a study that was stopped.
#
# ## A guarantee for one site
#
# A study is about kinds of terrain, a guarantee about your site. Its coarse prior shows how rough the ground is at
# its own resolution, the class of surface states how rough it is below that. Here the site has snow on it, and a prior with
# cells of 30 m.

# %%
fine = Grid((500_000.0, 6_700_000.0, 500_590.0, 6_700_590.0), 10.0, "EPSG:32608")
truth = matern_field(fine, np.random.default_rng(4), relief_m=20.0, nu=2.5, length_scale_m=220.0)
prior = truth.block_mean(30.0)
area = SurveyArea.rectangle((500_090.0, 6_700_090.0, 500_510.0, 6_700_510.0), fine.crs)
prior.write("srtm.tif")
area.write("site.gpkg")
promise = guarantee(area, prior, MapRequirement(0.4572, 0.9, surface="snow", n_simulations=20))
print("holds:", promise.holds)
print(
    f"{promise.config.swaths} swaths, probability {promise.predicted.probability:.0%}, simulated {promise.simulated_share:.0%}"
)
print(promise.assumptions)

# %%
plan_map(area, promise.route, terrain=prior)

# %% [markdown]
# Less certain ground takes more swaths, or is refused with the error that can be reached:

# %%
ice = guarantee(area, prior, MapRequirement(0.4572, 0.9, surface="bare-ice", n_simulations=20))
if ice.holds:
    print(f"bare ice: {ice.config.swaths} swaths")
else:
    print(f"bare ice: refused; {ice.reachable_m:.2f} m can be reached with a probability of 90 %")

# %% [markdown]
# What a guarantee rests on, and how often it was met in tests, is explained in
# [Guarantees](../explanation/guarantees.md).
