# %% [markdown]
# # Seek a source by its counts
#
# A rover carries a detector of radiation. Somewhere on the site lies a source of unknown strength. The rover counts on the way, goes where
# the next count says most about the source for its time, and stops where the source lies within 10 m of the stated place with 90 %
# probability. With counts of your own, the command line gives the same answers:
#
# ```shell
# firnline counts gamma.csv --crs EPSG:32608 --grid 4 --limit 30 --source radiation --next-from 500055,6700010 --out tutorial
# ```

# %%
import matplotlib.pyplot as plt
import numpy as np

from planners.source_search import SourceSeeker
from sim.instruments.counter import RadiationWorld
from survey import SurveyArea
from survey.core.streams import stream
from survey.reconstruction.counts.sources import InverseSquare, SourcePrior, SourceSearch

# %% [markdown]
# ## The world
#
# The simulated ground is uneven, its background varies, and the detector has dead time: the search knows of none of this.

# %%
bounds = (0.0, 0.0, 200.0, 200.0)
world = RadiationWorld(
    np.array([150.0, 120.0]), 8e3, 10.0, stream(3, "world"), uneven=0.2, relief_m=1.0, dead_time_s=1e-4
)

# %% [markdown]
# ## The search
#
# Each leg ends at the place with the largest expected information per time. Counts are taken about every 10 m on the way, and for 20 s at its end.

# %%
seeker = SourceSeeker(SurveyArea.rectangle(bounds, "EPSG:32608"))
search = SourceSearch(InverseSquare(), SourcePrior(bounds, (1e2, 1e6), (0.5, 100.0)), stream(3, "particles"))
way, found = [np.array([5.0, 5.0])], None
while found is None and len(way) < 80:
    to = seeker.next_place(search, way[-1])
    leg_m = float(np.hypot(*(to - way[-1])))
    n = max(1, int(leg_m // 10.0))
    on_the_way = np.linspace(way[-1], to, n + 1)[1:]
    search.add(
        world.count(np.vstack([on_the_way, to]), np.r_[np.full(n, max(leg_m / n, 1.0)), seeker.count_s])
    )
    way.append(to)
    found = seeker.found(search)
assert found is not None
driven_m = np.hypot(*np.diff(way, axis=0).T).sum()
print(f"stated at {found.xy.round(1)} after {driven_m:.0f} m with {100 * found.probability:.0f} %")
print(f"the source lies at {world.source_xy}, {np.hypot(*(found.xy - world.source_xy)):.1f} m away")

# %% [markdown]
# ## What the particles say

# %%
figure, axes = plt.subplots(figsize=(5.0, 5.0))
axes.plot(*np.array(way).T, color="0.4", linewidth=0.8, label="way")
axes.plot(*search.belief.particles[:, :2].T, ".", markersize=2, label="particles")
axes.plot(*world.source_xy, "x", color="crimson", markersize=9, label="source")
axes.set(xlim=bounds[::2], ylim=bounds[1::2], aspect="equal", xlabel="Easting [m]", ylabel="Northing [m]")
axes.legend(loc="upper left")
plt.show()
