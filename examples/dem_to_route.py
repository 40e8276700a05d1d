# %% [markdown]
# # My DEM to a route
#
# You have the outline of a site as KML and a satellite DEM in degrees, as Copernicus GLO-30 comes. You want the
# shortest route whose map is expected to have an RMSE of 0.45 m, as a mission for QGroundControl.
#
# Everything below runs in a few seconds. The same on the command line:
#
# ```shell
# firnline plan site.kml --prior copernicus.tif --pattern best --rmse 0.45 -o route.geojson
# firnline export route.geojson survey.plan --area site.kml --dem copernicus.tif --speed 1.2
# ```

# %%
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin

from firnline import BestConfig, Dem, LawnmowerConfig, Surroundings, SurveyArea, plan, write_plan
from planners import predict_error, terrain_kernel
from survey.figures import plan_map

# %% [markdown]
# ## The data
#
# A real DEM would be downloaded. Here a small one is made: cells of one arc second by 1.5 arc seconds near 58.5° N,
# as Copernicus has them there, with heights of a slope with hills. Longitude and latitude are in degrees (EPSG:4326).

# %%
lon = -134.56 + np.arange(45) * 1.5 / 3600.0
lat = 58.45 - np.arange(45) / 3600.0
east_m = (lon - lon[0]) * 111_320.0 * np.cos(np.radians(58.45))
north_m = (lat - lat[-1])[:, None] * 111_320.0
heights = 820.0 + 0.05 * east_m + 6.0 * np.sin(east_m / 90.0) * np.cos(north_m / 110.0)

with rasterio.open(
    "copernicus.tif",
    "w",
    driver="GTiff",
    width=45,
    height=45,
    count=1,
    dtype="float32",
    crs="EPSG:4326",
    transform=from_origin(lon[0], lat[0], 1.5 / 3600.0, 1.0 / 3600.0),
) as file:
    file.write(heights.astype("float32"), 1)

# %% [markdown]
# The site is a polygon as Google Earth saves it:

# %%
corners = [(-134.556, 58.4405), (-134.5475, 58.4405), (-134.5465, 58.4455), (-134.5555, 58.4460)]
ring = " ".join(f"{x},{y},0" for x, y in [*corners, corners[0]])
_ = Path("site.kml").write_text(
    '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>'
    "<name>site</name><Polygon><outerBoundaryIs><LinearRing>"
    f"<coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>",
    encoding="utf-8",
)

# %% [markdown]
# ## Read both
#
# Coordinates in degrees are projected to the UTM zone of the site. The vertical datum stays that of the file.

# %%
prior = Dem.read("copernicus.tif")
area = SurveyArea.read("site.kml", crs=prior.crs)
print(prior.crs.name, prior.shape, f"cells of {prior.step_m:.1f} m")
print(f"{area.ground_area_m2 / 1e4:.1f} ha")

# %% [markdown]
# ## What four swaths would give
#
# The prior shows how rough the terrain is: its covariance is fitted, and predicts the error of the map for any route.

# %%
kernel = terrain_kernel(prior, area)
four = plan(area, prior, LawnmowerConfig(swaths=4), kernel=kernel)
print(kernel)
print({name: round(four.prediction[name], 2) for name in ("length_m", "n_turns", "rmse_m")})

# %% [markdown]
# ## The shortest route for 0.45 m
#
# `best` compares straight and wavy swaths, their heading, spacing and distance from the border, and takes the shortest
# route whose predicted RMSE is small enough.

# %%
route = plan(area, prior, BestConfig(rmse_m=0.45), kernel=kernel)
print(
    route.pattern,
    {name: round(route.prediction[name], 2) for name in ("length_m", "n_turns", "rmse_m", "time_s")},
)

# %%
std = predict_error(route, area, kernel, noise_m=0.1).std
plan_map(area, route, terrain=prior, std=std)

# %% [markdown]
# The prediction rests on the covariance of the prior. Relief finer than two cells of the prior is not in it, so real
# ground is rougher than predicted: `firnline plan --require` adds such relief by the class of the surface, see
# [How many swaths](how_many_swaths.ipynb).
#
# ## Export to QGroundControl
#
# The `.plan` holds waypoints, speed, home position and a fence 10 m outside the outline.

# %%
write_plan(route, "survey.plan", around=Surroundings(area=area, terrain=prior, speed_m_s=1.2))
print(Path("survey.plan").read_text(encoding="utf-8")[:300])

# %% [markdown]
# Other endings write other formats: `.waypoints`, `.gpx`, `.kml`, `.kmz`, `.csv`, `.geojson`, `.gpkg`, `.wkt`.

# %%
for ending in ("gpx", "kml", "csv"):
    write_plan(route, f"survey.{ending}")
print(Path("survey.csv").read_text(encoding="utf-8").splitlines()[:3])
