# %% [markdown]
# # My drive to a map with honest σ
#
# You drove over snow with a camera and recorded a GPX track. This tutorial turns the folder of images into a path with
# covariances, the path and its landmarks into a map with a standard deviation, and checks that the standard deviation
# is honest. On the command line:
#
# ```shell
# firnline localize drive --gps drive/track.gpx
# firnline reconstruct localization/landmarks.gpkg --method joint --trajectory localization/trajectory.csv --grid 0.25
# firnline score reconstruction/dem.tif --truth lidar.tif
# ```

# %%
from pathlib import Path

import cv2
import numpy as np
from matplotlib import pyplot as plt
from pyproj import Transformer

from firnline import Camera, Dem, Grid, SurveyArea, reconstruct, score
from survey.figures import deviation_map, error_map, path_map
from vision_slam.recordings import open_recording

# %% [markdown]
# ## The data
#
# A real drive would be a folder of images. This one is drawn: 0.6 m of relief with a speckled surface, seen from a
# rover that drives two lanes of 16 m and a turn, with five images a second at 0.75 m/s. The camera looks ahead and down
# from 0.7 m. Everything in this section makes the folder; a reader with a recording of their own can skip it.

# %%
CRS, EAST, NORTH, UNIX_S = "EPSG:32608", 526_000.0, 6_478_000.0, 1_780_000_000.0
rng = np.random.default_rng(1)
grains = [
    cv2.GaussianBlur(rng.normal(size=(2400, 2400)), (0, 0), sigma) * 2.0 * sigma for sigma in (1.5, 3.5, 9.0)
]
speckle = (128.0 + 22.0 * sum(grains)).clip(0, 255).astype(np.float32)  # 60 pixels per metre


def height(x, y):
    """Height of the ground at local coordinates [m]."""
    return 0.3 * np.sin(x / 3.1) * np.cos(y / 2.6) + 0.02 * x


def lanes():
    """Positions and headings every 0.15 m: a lane, a turn to the left of 2.5 m radius, a lane back."""
    s = np.arange(0.0, 32.0 + 2.5 * np.pi, 0.15)
    turn = np.clip((s - 16.0) / 2.5, 0.0, np.pi)
    back = np.clip(s - 16.0 - 2.5 * np.pi, 0.0, None)
    x = 5.0 + np.minimum(s, 16.0) + 2.5 * np.sin(turn) - back
    return np.column_stack([x, 10.0 - 2.5 * np.cos(turn)]), turn


def pose(xy, heading):
    """T_local_body of a rover; its body frame is 0.7 m above the ground, where camera and antenna are."""
    e = 0.3
    normal = np.array(
        [
            height(xy[0] - e, xy[1]) - height(xy[0] + e, xy[1]),
            height(xy[0], xy[1] - e) - height(xy[0], xy[1] + e),
            2 * e,
        ]
    )
    up = normal / np.linalg.norm(normal)
    left = np.cross(up, [np.cos(heading), np.sin(heading), 0.0])
    left /= np.linalg.norm(left)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([np.cross(left, up), left, up]), [*xy, height(*xy) + 0.7]
    return T


# %%
camera_toml = """model = "pinhole"
width = 320
height = 240
matrix = [[260.0, 0.0, 159.5], [0.0, 260.0, 119.5], [0.0, 0.0, 1.0]]
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
T_body_camera = [[0.0, -0.38461538, 0.92307692, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -0.92307692, -0.38461538, 0.0], [0.0, 0.0, 0.0, 1.0]]
"""
drive = Path("drive")
(drive / "images").mkdir(parents=True, exist_ok=True)
(drive / "camera.toml").write_text(camera_toml, encoding="utf-8")
camera = Camera.read(drive / "camera.toml")
columns, rows = np.meshgrid(np.arange(320), np.arange(240))
rays_camera = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))


def draw(T):
    """Draw the image that the camera takes from a pose of the body."""
    eye = T @ camera.T_body_camera
    rays = rays_camera @ eye[:3, :3].T
    down = np.minimum(rays[:, 2], -1e-3)
    reach = (eye[2, 3] - height(*eye[:2, 3])) / -down
    for _ in range(12):
        ground = eye[:3, 3] + np.clip(reach, 0.0, 15.0)[:, None] * rays
        reach = np.clip(reach, 0.0, 15.0) + (ground[:, 2] - height(ground[:, 0], ground[:, 1])) / np.maximum(
            -down, 0.2
        )
    at = (ground[:, :2] * 60.0).astype(np.float32).reshape(240, 320, 2)
    image = cv2.remap(speckle, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    image[(reach > 12.0).reshape(240, 320)] = 225.0
    return image.astype(np.uint8)


xy, headings = lanes()
times = UNIX_S + np.arange(len(xy)) * 0.2
for k, (place, heading) in enumerate(zip(xy, headings, strict=True)):
    cv2.imwrite(str(drive / "images" / f"{k:04d}.png"), draw(pose(place, heading)))
(drive / "times.txt").write_text("".join(f"{t:.2f}\n" for t in times), encoding="utf-8")
_ = plt.imshow(cv2.imread(str(drive / "images" / "0040.png")))

# %% [markdown]
# The GPX track has a fix every second, with errors of 0.3 m as of a good receiver.

# %%
to_degrees = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
fixes = (
    np.column_stack([xy, height(*xy.T) + 0.7])[::5]
    + [EAST, NORTH, 800.0]
    + rng.normal(0.0, 0.3, (len(xy[::5]), 3))
)
points = [
    f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><ele>{z:.3f}</ele><time>{np.datetime64(int(t), "s")}Z</time></trkpt>'
    for (lon, lat), z, t in zip(
        np.column_stack(to_degrees.transform(*fixes.T[:2])), fixes[:, 2], times[::5], strict=True
    )
]
_ = (drive / "track.gpx").write_text(
    '<?xml version="1.0"?><gpx version="1.1" creator="tutorial" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    + "".join(points)
    + "</trkseg></trk></gpx>",
    encoding="utf-8",
)

# %% [markdown]
# ## Path and landmarks
#
# `open_recording` knows folders of images, TUM, EuRoC, KITTI and ROS bags. One camera knows no scale: it comes from the
# fixes. The errors of the receiver are stated: slow ones of 0.1 m, independent ones of 0.3 m.

# %%
recording = open_recording(drive, gps=drive / "track.gpx", crs=CRS)
config = recording.config(["localization.gps_bias_sigma_m=0.1", "localization.gps_white_sigma_m=0.3"])
estimate = recording.localize(config)
print(f"{estimate.length_m:.1f} m, {len(estimate.landmarks)} landmarks, {estimate.n_fixes} fixes")
print("\n".join(estimate.notes))

# %%
path = estimate.trajectory
local = path.position[:, :2] - [EAST, NORTH]
truth = np.column_stack(
    [np.interp(path.time_s, times, column) for column in (*xy.T, height(*xy.T) + 0.7)]
) + [EAST, NORTH, 800.0]
error = path.position - truth
sigma = np.sqrt(path.covariance[:, [0, 1, 2], [0, 1, 2]])
print("RMS error east, north, up [m]:", np.sqrt((error**2).mean(axis=0)).round(3))
print("claimed σ (RMS)            [m]:", np.sqrt((sigma**2).mean(axis=0)).round(3))
path_map(path.position, path.covariance[:, :3, :3], fixes=fixes, reference=truth)

# %% [markdown]
# ## The map
#
# Landmarks that were seen from one place share the error of that pose. `estimate.trajectory.error` holds how the errors
# of the poses are correlated; with it, map and path are estimated together. Without it the landmarks would count as independent,
# and the standard deviation of the map would be far too small. A tenth of the landmarks is enough here.

# %%
landmarks = estimate.points.select(np.arange(len(estimate.points)) % 10 == 0)
area = SurveyArea.rectangle((EAST + 8.0, NORTH + 6.0, EAST + 22.0, NORTH + 14.0), CRS)
grid = Grid.over(area.bounds, step_m=0.25, crs=CRS)
terrain = reconstruct(landmarks, grid, area=area, path=path.error)
real = Dem.on(grid, 800.0 + height(grid.x - EAST, grid.y[:, None] - NORTH))
naive = reconstruct(landmarks, grid, area=area)
real.write("lidar.tif")

# %% [markdown]
# ## Is σ honest?
#
# Here the true surface is known. An honest σ holds it within ±1.96 σ at about 95 % of the nodes, and errors divided by σ
# have a root mean square of about 1.

# %%
for name, candidate in (("map and path together", terrain), ("landmarks as independent", naive)):
    judged = score(candidate, truth=real, area=area)
    held = judged.calibration
    print(f"{name}: RMSE {judged.elevation.rmse_m:.3f} m, mean σ {np.nanmean(candidate.std.elevation):.3f} m")
    print(f"  within 95 % interval {held.coverage_95:.0%}, RMS of error / σ {held.z_rms:.1f}")

# %%
error_map(terrain, real, area=area)

# %%
deviation_map(terrain, area=area)

# %% [markdown]
# One drive of 60 m has few independent errors, so single figures scatter: the error of the receiver moves the map as
# one. Benchmarks with many drives are in the [reference](../reference/benchmarks/index.md). What σ includes and what it
# does not is explained in [What σ means here](../explanation/sigma.md).
