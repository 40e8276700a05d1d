# %% [markdown]
# # Two summers to a mass change
#
# Two surveys of a glacier, two years apart, become a change of volume and mass with its error, and the later map is
# judged by checkpoints. On the command line:
#
# ```shell
# firnline change 2026.tif 2024.tif --outline glacier.gpkg
# firnline score 2026.tif --checkpoints gnss.csv --standard asprs-edition-2 --class 0.50
# ```

# %%
import numpy as np
import shapely
from matplotlib import pyplot as plt

from firnline import Dem, Grid, change
from survey.scoring import Checkpoints, compare, score_at
from survey.terrain import matern_field

# %% [markdown]
# ## The data
#
# A valley of 1.6 × 1.2 km with a tongue of ice in it. Between the surveys the ice sank by 2.5 m at its lower end and
# by 0.5 m at its upper end. Each survey has errors of its own: noise, and slow errors of 0.3 m that are correlated over
# 150 m, as photogrammetry has them. The earlier survey is also shifted by 4 m to the east and 1 m upwards.

# %%
rng = np.random.default_rng(5)
grid = Grid((480_000.0, 6_500_000.0, 481_590.0, 6_501_190.0), 10.0, "EPSG:32608")
terrain = matern_field(grid, rng, relief_m=180.0, nu=2.5, length_scale_m=300.0)
tongue = shapely.Polygon(
    [
        (480_450, 6_500_300),
        (481_200, 6_500_250),
        (481_450, 6_500_600),
        (481_150, 6_500_950),
        (480_500, 6_500_850),
    ]
)
on_ice = shapely.contains_xy(tongue, *terrain.xy.T).reshape(terrain.shape)
thinning = np.interp(grid.x, [480_450.0, 481_450.0], [2.5, 0.5]) * on_ice


def surveyed(heights, sigma_m):
    """Add independent and correlated errors to heights."""
    slow = matern_field(grid, rng, nu=1.5, length_scale_m=150.0).elevation
    slow = (slow - slow.mean()) / slow.std() * 0.3
    return heights + slow + rng.normal(0.0, sigma_m, heights.shape)


later = Dem.on(grid, surveyed(terrain.elevation - thinning, 0.1))
shifted = terrain.at(terrain.xy - [4.0, 0.0]).reshape(terrain.shape)
shifted = np.where(np.isnan(shifted), terrain.elevation, shifted)
earlier = Dem.on(grid, surveyed(shifted + 1.0, 0.3))

# %% [markdown]
# ## Change of volume and mass
#
# `align=True` corrects shift, tilt and bias by curvature of the earlier survey by the ground that did not change (Nuth and
# Kääb 2011); the command does so by default. The errors of the difference are then measured on the same ground: their variogram shows over which distance they are
# correlated. An error that is correlated over hundreds of metres does not average out over a glacier, so the
# standard deviation of the volume is many times that of independent errors.

# %%
result = change(later, earlier, {"tongue": tongue}, align=True)
print(result.alignment)
volume = result.volumes[0]
print(
    f"volume  {volume.volume_m3:,.0f} ± {volume.std_m3:,.0f} m³; if cells were independent ± {volume.naive_std_m3:,.0f} m³"
)
print(f"true    {-thinning.sum() * 100.0:,.0f} m³")
mass = volume.mass(density_kg_m3=850.0, density_std_kg_m3=60.0)
print(f"mass balance {mass.specific_m_we:.2f} ± {mass.specific_std_m_we:.2f} m water equivalent")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
result.difference.plot(ax=left)
left.plot(*tongue.exterior.xy, color="white")
left.set_title("Later minus earlier [m]")
lags_m = np.linspace(1.0, 500.0, 100)
right.plot(lags_m, result.variogram.at(lags_m))
_ = right.set(title="Variogram of the errors", xlabel="Distance [m]", ylabel="[m²]", ylim=(0.0, None))

# %% [markdown]
# Density is the other unknown: 850 ± 60 kg/m³ holds for glaciers over five years and more (Huss 2013). Over two summers
# a measured density is better; its error is included in that of the mass.
#
# ## Judge the later map by checkpoints
#
# Checkpoints are measured independently of the map and better. Newer standards ask for at least 30. Here 36 points are
# measured by a receiver of 2 cm. The class is the RMSE that was agreed on; the standard's own conditions decide whether
# there is a verdict at all.

# %%
offsets_x, offsets_y = np.meshgrid(
    np.linspace(480_100.0, 481_500.0, 6), np.linspace(6_500_100.0, 6_501_100.0, 6)
)
places = np.column_stack([offsets_x.ravel(), offsets_y.ravel()]) + rng.uniform(-40.0, 40.0, (36, 2))
sunk = Dem.on(grid, terrain.elevation - thinning).at(places)
points = Checkpoints(np.column_stack([places, sunk + rng.normal(0.0, 0.02, 36)]), 0.02, "EPSG:32608")
judged = score_at(compare(later, points), class_m=0.50)
print(f"RMSE {judged.elevation.rmse_m:.2f} m, 95 % interval {judged.interval}")
print(judged.assessments[0].outcome)
