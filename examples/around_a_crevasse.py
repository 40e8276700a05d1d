# %% [markdown]
# # Drive around a crevasse that no prior shows
#
# A swath is planned over ice that looks smooth from a satellite. A scanner on the rover sees a crevasse across it from some metres away, and the
# rover changes its route before it is there. With points of a scanner of your own, the command line gives the same answer:
#
# ```shell
# firnline reroute line.geojson seen.csv --at 500002,6700000 --out tutorial
# ```

# %%
import matplotlib.pyplot as plt
import numpy as np

from planners.look_ahead import LookAheadSettings
from sim.config.sensors import LidarConfig
from sim.simulate.look_ahead_drive import LethalGround, PoseErrors, drive_with_look_ahead
from survey import Dem, Grid, Leg, Route, SurveyArea

# %% [markdown]
# ## The ground
#
# Gentle ice with a crevasse 1 m wide and 4 m deep. Lethal is where a rover 1 m long would stand on a rise of more than 25°.

# %%
grid = Grid((0.0, 0.0, 60.0, 40.0), 0.25, "EPSG:32608")
x, y = np.meshgrid(grid.x, grid.y)
ice = 0.05 * x + 0.05 * np.sin(x / 3.0) * np.cos(y / 2.0)
terrain = Dem.on(grid, np.where((np.abs(x - 32.0 + 0.3 * y) < 0.5) & (y > 12.0), ice - 4.0, ice))
area = SurveyArea.rectangle((2.0, 2.0, 58.0, 38.0), grid.crs)
route = Route((Leg("swath", [[6.0, 20.0], [54.0, 20.0]]),), grid.crs, "line")
settings = LookAheadSettings()
planned = np.column_stack([np.arange(6.0, 54.0, 0.1), np.full(480, 20.0)])
print(
    f"the planned route reaches lethal ground {LethalGround(terrain, settings.limit).entries(planned)} time"
)

# %% [markdown]
# ## The drive
#
# The rover scans every half metre. Its scans are placed by an estimated pose, which errs in place, attitude and steering.

# %%
lidar = LidarConfig(beams=32, columns=360, elevation_deg=(-35.0, 3.0), range_m=30.0)
drive = drive_with_look_ahead(
    terrain, route, area, lidar, stated=lidar, settings=settings, errors=PoseErrors(), seed=1
)
print(
    f"the driven route reaches it {drive.n_entries} times, over {drive.driven_m:.0f} m instead of {drive.planned_m:.0f} m"
)
print(f"{drive.skipped_m:.0f} m of the swath are left out")

# %% [markdown]
# ## The way

# %%
figure, axes = plt.subplots(figsize=(6.0, 4.0))
axes.imshow(terrain.elevation - ice, extent=(0.0, 60.0, 0.0, 40.0), cmap="Greys_r")
axes.plot(*planned.T, ":", color="steelblue", label="planned")
axes.plot(*drive.xy.T, color="crimson", label="driven")
axes.set(xlabel="Easting [m]", ylabel="Northing [m]")
axes.legend(loc="upper right")
plt.show()
