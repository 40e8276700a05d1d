# %% [markdown]
# # Map ice that leans over
#
# A stream has undercut a wall of ice. A map of heights has one height over each place, and so neither the notch nor the ceiling above it. Scans from
# three places show both, and become a mesh with a standard deviation. With scans of your own, the command line does the same:
#
# ```shell
# firnline overhangs undercut.ply --grid 0.3 --out tutorial
# ```

# %%
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from firnline import actions
from survey import SurfacePoints

# %% [markdown]
# ## The wall and its scans
#
# The wall runs to the north; its vertical section is a line of six corners. Each beam ends where it first meets the line.

# %%
wall = np.array([[-8.0, 0.0], [0.8, 0.0], [0.9, 0.4], [0.0, 1.1], [-0.1, 3.0], [8.0, 3.2]])
azimuth, elevation = np.radians(np.meshgrid(np.arange(-65.0, 65.0), np.arange(-55.5, 40.0)))
beams = np.column_stack(
    [
        (np.cos(elevation) * np.cos(azimuth)).ravel(),
        (np.cos(elevation) * np.sin(azimuth)).ravel(),
        np.sin(elevation).ravel(),
    ]
)
rng = np.random.default_rng(5)


def scan(place):
    """Return the returns (N, 3) [m] of all beams from a place, with 0.02 m of noise along the beams."""
    ranges = np.full(len(beams), np.inf)
    for start, end in pairwise(wall):
        side, offset = end - start, start - place[[0, 2]]
        across = beams[:, 0] * side[1] - beams[:, 2] * side[0]
        range_m = (offset[0] * side[1] - offset[1] * side[0]) / across
        part = (offset[0] * beams[:, 2] - offset[1] * beams[:, 0]) / across
        is_met = (range_m > 0.0) & (part >= 0.0) & (part <= 1.0)
        ranges = np.where(is_met, np.minimum(ranges, range_m), ranges)
    seen = ranges < 12.0
    return place + (ranges[seen] + 0.02 * rng.standard_normal(seen.sum()))[:, None] * beams[seen]


corner = np.array([500_000.0, 6_700_000.0, 0.0])
places = [np.array([-6.0, north, 1.6]) for north in (-4.0, 0.0, 4.0)]
scans = [scan(place) for place in places]
origins = [np.broadcast_to(place, points.shape) for place, points in zip(places, scans, strict=True)]
SurfacePoints(
    np.vstack(scans) + corner, sigma_m=0.02, origins=np.vstack(origins) + corner, crs="EPSG:32608"
).write("undercut.ply")

# %% [markdown]
# ## The surface

# %%
made = actions.overhangs(
    actions.OverhangsRequest(sources=[Path("undercut.ply")], step_m=0.3, out=Path("undercut"))
)
print("\n".join(made.lines()))

# %% [markdown]
# Along the section the surface lies below itself. No beam reached the ground above the wall: beyond its edge the surface is continued over six steps,
# and is marked as unsupported.

# %%
section = made.surface.section(corner[:2] + [-6.0, 0.5], corner[:2] + [4.0, 0.5])
figure, axes = plt.subplots(figsize=(7.0, 3.4), layout="constrained")
axes.plot(*wall.T, color="0.7", linewidth=4.0, label="true")
for along, z, is_supported in zip(section.along_m, section.z_m, section.is_supported, strict=True):
    axes.plot(along - 6.0, z, color="steelblue" if is_supported else "crimson")
axes.plot([], [], color="steelblue", label="estimated")
axes.plot([], [], color="crimson", label="without returns")
axes.set(xlim=(-6.0, 4.0), ylim=(-0.5, 4.0), aspect="equal", xlabel="Easting [m]", ylabel="Height [m]")
axes.legend(loc="upper left")
plt.show()

# %% [markdown]
# The mesh errs by two centimetres where returns support it, less at planes and more at sharp edges, which are rounded.

# %%
seen = (made.surface.is_supported) & (np.abs(made.surface.nodes[:, 0] - corner[0]) < 6.0)
nodes = made.surface.nodes[seen][:, [0, 2]] - corner[[0, 2]]
sides = wall[1:] - wall[:-1]
along = np.clip(((nodes[:, None] - wall[:-1]) * sides).sum(axis=2) / (sides**2).sum(axis=1), 0.0, 1.0)
error = np.linalg.norm(wall[:-1] + along[:, :, None] * sides - nodes[:, None], axis=2).min(axis=1)
print(f"root mean square: {np.sqrt(np.mean(error**2)):.3f} m, 95 % below {np.quantile(error, 0.95):.3f} m")
