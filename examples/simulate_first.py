# %% [markdown]
# # Simulate before you ship
#
# Before a rover is shipped to a glacier, its survey can be simulated: the route is planned, sensors with realistic
# errors record the drive, path and map are estimated from the recording alone, and the map is judged against the
# simulated truth. Then something goes wrong, on purpose. On the command line:
#
# ```shell
# firnline example srtm_ridge
# firnline run srtm_ridge.toml
# firnline run srtm_ridge.toml --set planner.swaths=8
# ```

# %%
from pathlib import Path

import numpy as np

from firnline import (
    AidsConfig,
    Grid,
    LawnmowerConfig,
    SensorConfig,
    SurveyArea,
    localize,
    plan,
    reconstruct,
    score,
    simulate,
)
from survey.figures import error_map, executed_route
from survey.terrain import matern_field, satellite_copy

# %% [markdown]
# ## The site
#
# A site of 180 × 120 m with 10 m of relief, which is the truth of the simulation, and a satellite's view of it in cells of
# 30 m with an error of 1 m. Planner and estimator see the satellite only.

# %%
rng = np.random.default_rng(11)
grid = Grid((500_000.0, 6_700_000.0, 500_238.0, 6_700_178.0), 2.0, "EPSG:32608")
terrain = matern_field(grid, rng, relief_m=10.0, nu=2.5, length_scale_m=70.0)
prior = satellite_copy(terrain, rng=rng, cell_m=30.0, sigma_m=1.0)
area = SurveyArea.rectangle((500_030.0, 6_700_030.0, 500_210.0, 6_700_150.0), grid.crs)
route = plan(area, prior, LawnmowerConfig(swaths=3))
print({name: round(route.prediction[name], 1) for name in ("length_m", "n_turns", "time_s", "energy_j")})

# %% [markdown]
# ## Drive, localize, map, judge
#
# `simulate` returns what the rover sensed and, apart from it, the truth. The estimator gets the recording alone.


# %%
def survey(name, gps_bias_sigma_m=1.0, aids=None):
    """Drive the route once, map the terrain and judge the map."""
    sensors = SensorConfig(gps_bias_sigma_m=gps_bias_sigma_m, landmarks_per_m=0.5)
    recording, truth = simulate(terrain, route, seed=3, sensors=sensors, aids=aids)
    found = localize(recording)
    nodes = Grid.over(area.bounds, step_m=6.0, crs=grid.crs)
    made = reconstruct(found.points, nodes, prior=prior, area=area, path=found.trajectory.error)
    judged = score(made, truth=terrain, area=area, route=route)
    print(
        f"{name}: RMSE {judged.elevation.rmse_m:.2f} m, bias {judged.elevation.bias_m:+.2f} m, "
        f"mean σ {np.nanmean(made.std.elevation):.2f} m, within the 95 % interval {judged.calibration.coverage_95:.0%}"
    )
    return made, found, truth


made, found, truth = survey("as equipped")

# %%
error_map(made, terrain, area=area, route=route)

# %%
executed_route(route, truth.trajectory.position[:, :2], found.trajectory.position[:, :2], area=area)

# %% [markdown]
# ## What if
#
# A worse receiver, four surveyed stakes: one argument each. The estimator assumes what its configuration
# says (`LocalizationConfig`), so with a receiver that is worse than assumed too few nodes lie within the interval.

# %%
survey("receiver of 3 m", gps_bias_sigma_m=3.0)
survey("with four stakes", aids=AidsConfig(stakes=4))

# %% [markdown]
# ## A mission in images, with faults
#
# The vision fidelity drives a tracked rover by rigid-body contact over rendered snow and takes a second of CPU time for a
# metre, so it is not run here. A mission file names what goes wrong, and when; `firnline run` does the rest.

# %%
MISSION = """
schema_version = 1
name = "white-out"
seed = 3
fidelity = "vision"
terrain = { source = "random", size_m = 120.0, relief_m = 6.0, length_scale_m = 60.0 }
area = { bounds_m = [526025.0, 6478040.0, 526095.0, 6478070.0] }
planner = { pattern = "lawnmower", swaths = 2, inset_share = 0.25 }
physics = { steer_by = "estimate" }

[[faults]]             # nothing but white for ten seconds
component = "camera"
failure = "whiteout"
from_s = 40.0
until_s = 50.0

[[faults]]             # no fixes for a minute
component = "gps"
failure = "off"
from_s = 60.0
until_s = 120.0
"""
Path("white_out.toml").write_text(MISSION, encoding="utf-8")

from firnline import read_mission

mission = read_mission(Path("white_out.toml"))
print(
    [
        f"{fault.component}: {fault.failure} from {fault.from_s} s to {fault.until_s} s"
        for fault in mission.faults
    ]
)

# %% [markdown]
# ```shell
# firnline run white_out.toml --dry-run     # checks all input, and writes nothing
# firnline run white_out.toml               # about a minute on two cores
# ```
#
# The report shows the drive beside its plan, what the camera saw, errors beside claims, and how the rover found its way
# through the white-out by wheels and gyro.
