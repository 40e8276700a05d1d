"""Small inputs: a mission and a Monte Carlo study of about a second, and scenery without features."""

UTM = "EPSG:32608"
_MAP = """[reconstruction]
grid_step_m = 5.0
[reconstruction.gp]
fit = false
variance_m2 = 4.0
length_scale_m = 40.0
"""
MISSION = f"""
schema_version = 1
name = "small"
seed = 11
[terrain]
source = "random"
size_m = 150.0
relief_m = 6.0
length_scale_m = 60.0
micro_relief_sd_m = 0.1
step_m = 3.0
[planner]
pattern = "lawnmower"
swaths = 2
[sensors]
landmarks_per_m = 0.5
{_MAP}nugget_m = 0.1
"""
IDEAL_MISSION = f"""
schema_version = 1
name = "small"
fidelity = "ideal"
[terrain]
source = "random"
size_m = 150.0
step_m = 3.0
length_scale_m = 60.0
[planner]
pattern = "lawnmower"
swaths = 2
{_MAP}"""
STUDY = """
schema_version = 1
name = "small"
trials = 3
swaths = [2]
map_step_m = 25.0
[[terrains]]
source = "random"
name = "smooth"
family = "squared-exponential"
size_m = 200.0
length_scale_m = 80.0
[[planners]]
pattern = "lawnmower"
"""
SECOND_PATTERN = """
[[planners]]
pattern = "piecewise-continuous"
"""
"""Another planner for `STUDY`."""
BARE_SCENERY = {
    "dune_sd_m": 0.0,
    "sastrugi_sd_m": 0.0,
    "hummock_sd_m": 0.0,
    "crevasses_per_ha": 0.0,
    "pools_per_ha": 0.0,
    "channels_per_ha": 0.0,
    "dirt_cones_per_ha": 0.0,
}
"""Settings of `sim.config.world.SceneryConfig` for terrain without any scenery."""
