"""From points to a map, in one call."""

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from threadpoolctl import threadpool_limits

from survey.core.errors import InputError
from survey.core.geodesy import same_crs
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.path_error import PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.base import ELEVATION, UNSEEN, Reconstruction
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.mean import Mean
from survey.reconstruction.triangulation import triangulate

Method = Literal["gp", "dense", "tin"]


def reconstruct(
    points: SurfacePoints,
    grid: Grid,
    prior: Dem | Mean | None = None,
    *,
    method: Method = "gp",
    config: GaussianProcessConfig | None = None,
    value: str = ELEVATION,
    area: SurveyArea | None = None,
    path: PathError | None = None,
    joint: JointConfig | None = None,
    rays: bool = False,
) -> Reconstruction:
    """Map the terrain, or another sampled quantity, from points.

    Parameters
    ----------
    points : SurfacePoints
        What was measured, with its uncertainty.
    grid : Grid
        The nodes to map, in the points' CRS.
    prior : Dem or Mean, optional
        What the surface is expected to be, e.g. a satellite's coarse elevation model;
        without it a constant, or a plane when `config` says so.
    method : {"gp", "dense", "tin"}
        The fast Gaussian process, the dense one, or linear interpolation in triangles,
        which knows no prior and leaves NaN outside the points' hull.
    config : GaussianProcessConfig, optional
        By default everything is fitted to the points.
    value : str
        ``elevation_m``, or the name of a value that the points carry.
    area : SurveyArea, optional
        Nodes outside it get NaN.
    path : PathError, optional
        What the poses share from which the points were seen (``trajectory.error``): then
        terrain and path are one estimate, and a prior's cells are measurements of means
        (`JointTerrain`, which gives the corrected path too). For ``gp`` and elevations.
    joint : JointConfig, optional
        Settings of that estimate.
    rays : bool
        Whether the points' lines of sight bound the map (`below_sight_lines`); they need origins.

    Returns
    -------
    Reconstruction
        Mean, standard deviation and support on the grid.

    Raises
    ------
    InputError
        Points, grid, prior or area in different systems, a prior that does not cover the
        grid, too few points, or a task beyond the memory allowed.
    """
    same_crs(points.crs, grid.crs, "the points and the grid")
    if method not in get_args(Method):
        raise InputError(f"the method {method!r} is not known; take one of {', '.join(get_args(Method))}.")
    if path is not None:
        result = _joint(points, grid, prior, path, method=method, value=value, config=config, joint=joint)
    elif method == "tin":
        result = triangulate(points, grid, quantity=value)
    else:
        model = GaussianProcessTerrain(config or GaussianProcessConfig(), prior, method, value, grid.bounds)
        # Threads that spin while they wait are slower on a shared machine, and one order of sums keeps the bytes.
        with threadpool_limits(limits=1, user_api="blas"):
            result = model.fit(points).grid(grid)
    if rays:
        # Here, because compiled support is only needed with lines of sight.
        from survey.reconstruction.line_of_sight.truncation import below_sight_lines

        result = below_sight_lines(result, points)
    return result if area is None else within(result, area)


def _joint(
    points: SurfacePoints,
    grid: Grid,
    prior: Dem | Mean | None,
    path: PathError,
    *,
    method: Method,
    value: str,
    config: GaussianProcessConfig | None,
    joint: JointConfig | None,
) -> Reconstruction:
    if method != "gp" or value != ELEVATION or isinstance(prior, Mean):
        raise InputError(
            f"map and path as one estimate need method = gp, elevations and a prior in cells; {method}, {value} and "
            f"{type(prior).__name__} were given, leave the path out."
        )
    # Here, because compiling support costs half a second that other methods need not pay.
    from survey.reconstruction.joint.joint_map import JointTerrain

    model = JointTerrain(path, prior, config or GaussianProcessConfig(), joint or JointConfig())
    with threadpool_limits(limits=1, user_api="blas"):
        return model.map(points, grid).reconstruction


def within(result: Reconstruction, area: SurveyArea) -> Reconstruction:
    """Return the map with NaN outside an area; refuse an area that holds no node."""
    area.require_crs(result.mean.crs, "the map")
    inside = area.contains(result.mean.xy).reshape(result.mean.shape)
    if not inside.any():
        raise InputError(
            "no node of the grid lies in the survey area; check that both are in the same place."
        )

    def cut(dem: Dem) -> Dem:
        return Dem.on(dem.grid(), np.where(inside, dem.elevation, np.nan), dem.vertical_datum)

    return replace(
        result,
        mean=cut(result.mean),
        std=cut(result.std),
        support=np.where(inside, result.support, UNSEEN),
        lower=cut(result.lower) if result.lower else None,
        upper=cut(result.upper) if result.upper else None,
    )
