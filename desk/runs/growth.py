"""Map of a run as it grows: from the landmarks of the first swaths, of more of them, and of all."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from desk.runs.layers import map_layers
from sim.mission.fleet import drive_folders
from survey.core.arrays import IntArray
from survey.core.run_folder import RunFolder
from survey.data.area import SurveyArea
from survey.data.grid import Grid
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.mapping import reconstruct

_MOST_MAPS = 12
_MOST_POINTS = 700
_NODES_ALONG = 36
_SAMPLE_STEP_M = 2.0


def growing_maps(run: RunFolder, kernel: Kernel) -> Iterator[dict[str, Any]]:
    """Map the landmarks of the first swaths, and of more swaths each time, on a coarse grid.

    Yields: ``swaths`` that were driven ``of`` all, and the pictures ``elevation`` and ``sigma``. The final
    map of the run is made from all landmarks and finer.
    """
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    route = Route.read(run.folder("simulate") / "driven_route.geojson")
    places = drive_folders(run.folder("localize"))
    parts = [SurfacePoints.read(place / "surface_points.gpkg") for place in places]
    xyz, sigma = np.vstack([part.xyz for part in parts]), np.concatenate([part.sigma_z for part in parts])
    swath = _swath_of(route, xyz[:, :2])
    xmin, ymin, xmax, ymax = area.bounds
    grid = Grid.over(area.bounds, max(xmax - xmin, ymax - ymin) / _NODES_ALONG, area.crs)
    config = GaussianProcessConfig(fit=False, kernel=kernel)
    n_swaths = len(route.swaths)
    for n in np.unique(np.linspace(1, n_swaths, min(n_swaths, _MOST_MAPS)).round().astype(int)):
        chosen = np.flatnonzero(swath < n)
        chosen = chosen[:: max(1, -(-len(chosen) // _MOST_POINTS))]
        if len(chosen) < 3:
            continue
        points = SurfacePoints(xyz[chosen], sigma_m=sigma[chosen], crs=area.crs)
        map_ = reconstruct(points, grid, method="dense", config=config, area=area)
        yield {"swaths": int(n), "of": n_swaths, **map_layers(map_)}


def _swath_of(route: Route, xy: Any) -> IntArray:
    """Return for each place the number of the swath, in driving order, that passes it nearest."""
    samples, owner = [], []
    for k, leg in enumerate(route.swaths):
        along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(leg.xy, axis=0).T))]
        at = np.linspace(0.0, along[-1], max(2, int(along[-1] / _SAMPLE_STEP_M)))
        samples.append(np.column_stack([np.interp(at, along, leg.xy[:, axis]) for axis in (0, 1)]))
        owner.append(np.full(len(at), k))
    nearest = cKDTree(np.vstack(samples)).query(xy)[1]
    numbers: IntArray = np.concatenate(owner)[nearest]
    return numbers
