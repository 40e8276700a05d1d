"""A small mission and a small Monte Carlo study, each done in about a second."""

UTM = "EPSG:32608"
MISSION = """
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
[reconstruction]
grid_step_m = 5.0
[reconstruction.gp]
fit = false
variance_m2 = 4.0
length_scale_m = 40.0
nugget_m = 0.1
"""
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
