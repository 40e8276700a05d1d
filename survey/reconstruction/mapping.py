"""Terrain reconstruction from points or scans by a method of the registry.

`reconstruct` maps points in one call. Missions, Monte Carlo studies and the command map landmarks by `map_landmarks`, so that
all of them follow the same rules:

* points that name keyframes, of a path whose error is known, are mapped jointly with it (gp becomes joint), unless
  ``landmark_errors`` says that they count as independent;
* gp, dense and joint take the prior's cells as measurements; points beyond its edge are left out unless the map is joint;
* gross blunders of the heights are left out and named in the record;
* heights that contradict one another at one place are named, and no standard deviation there is below their scatter;
* lines of sight bound the map when ``rays`` is set.

`map_scans` maps scans one after the other.
"""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from survey.core import FloatArray, InputError, Progress, Section, check_types, same_crs
from survey.data import Dem, Grid, PathError, SurfacePoints, SurveyArea
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.gp.mean import Mean
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    MethodSettings,
    ReconstructionMethod,
    ScanSettings,
)
from survey.reconstruction.observations import Contradictions, sound_points, with_scatter, without_blunders
from survey.reconstruction.registry import (
    METHODS,
    LandmarkErrors,
    ReconstructionConfig,
    method_named,
    names_where,
)
from survey.reconstruction.terrain_map import ELEVATION, UNSEEN, Reconstruction


@check_types
def reconstruct(
    points: SurfacePoints,
    grid: Grid,
    prior: Dem | Mean | None = None,
    *,
    method: str = "gp",
    config: Section | None = None,
    kernel: Kernel | str | None = None,
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
        Measured points with their uncertainty.
    grid : Grid
        The nodes to map, in the points' CRS.
    prior : Dem or Mean, optional
        Expected surface, e.g. a satellite's coarse elevation model; without it a constant, or a plane when
        `config` says so. Only the Gaussian processes use it.
    method : {"gp", "joint", "dense", "tin", "field", "emap", "carving"}
        Fourier Gaussian process, the same together with the path, dense Gaussian process, linear interpolation in
        triangles (NaN outside the points' hull), Gaussian field on a lattice, spring lattice, or space-carving kernels.
    config : Section, optional
        Settings of the method: `GaussianProcessConfig`, `FieldLatticeConfig`, `SpringLatticeConfig` or
        `SpaceCarvingConfig`. By default everything is fitted to the points.
    kernel : Kernel or str, optional
        Covariance function of a Gaussian process, or the name of its family (``matern-3/2``); with a `config` it
        replaces the one stated there. A fit starts from it.
    value : str
        ``elevation_m``, or the name of a value that the points carry (gp, dense and tin).
    area : SurveyArea, optional
        Nodes outside it get NaN.
    path : PathError, optional
        Error that the points share through the poses they were seen from (``trajectory.error``): with it gp
        means joint, terrain and path are one estimate, and a prior's cells are measurements of means.
    joint : JointConfig, optional
        Settings of that estimate.
    rays : bool
        Whether the points' lines of sight bound the map; the points then need origins.

    Returns
    -------
    Reconstruction
        Mean, standard deviation and support on the grid.

    Raises
    ------
    InputError
        Points, grid, prior or area in different systems, a prior that does not cover the grid, too few points, heights
        in feet among heights in metres, places far from all others where no area is given, or something that the
        method lacks.
    CapacityError
        A task beyond the memory allowed.
    TypeError
        Settings of another method.

    Notes
    -----
    One height per place: overhangs are not mapped.

    Gross blunders of the heights are left out, and the diagnostics name them (``blunders``).

    Examples
    --------
    >>> corners = SurfacePoints([[0, 0, 0], [4, 0, 4], [0, 4, 0]], sigma_m=0.1, crs="EPSG:32608")
    >>> reconstruct(corners, Grid((0.0, 0.0, 2.0, 2.0), 1.0), method="tin").mean.elevation[2]
    array([0., 1., 2.])
    """
    chosen = choose_method(method, path)
    if kernel is not None:
        config = _with_kernel(chosen, config, kernel)
    configs = MethodSettings.of(*(given for given in (config, joint) if given is not None))
    _require_kinds(chosen, [config] if config is not None else [])
    task = MappingTask(points, grid, prior, path, value, configs, rays, area=area)
    result = run_method(chosen, task).reconstruction
    return result if area is None else cut_to_area(result, area)


def choose_method(
    name: str, path: PathError | None, landmark_errors: LandmarkErrors = "joint"
) -> ReconstructionMethod:
    """Return the method of a name; gp becomes joint where the points share the path's error."""
    shares = path is not None and landmark_errors == "joint"
    return method_named("joint" if name == "gp" and shares else name)


def run_method(method: ReconstructionMethod, task: MappingTask) -> MappedTerrain:
    """Check the points, run a method, and bound its map by lines of sight where it does not do so itself."""
    same_crs(task.points.crs, task.grid.crs, "the points and the grid")
    _require_fit(method, task)
    method.require_room(task.grid.bounds, task.grid.step_m, task.configs)
    uses_sight_lines = task.rays or method.begin is not None
    points, n_low = task.points, 0
    if uses_sight_lines:
        # Here, because compiled support is only needed with lines of sight.
        from survey.reconstruction.line_of_sight.returns import without_low_returns

        points, n_low = without_low_returns(points)
    task = _with_sound_points(replace(task, points=points))
    points, scattered = with_scatter(task.points, task.quantity)
    # Threads that spin while they wait are slower on a shared machine, and one order of sums keeps the bytes.
    with threadpool_limits(limits=1, user_api="blas"):
        mapped = method.run(replace(task, points=points))
    if task.rays and method.sight_lines == "truncation":
        from survey.reconstruction.line_of_sight.ceiling import below_sight_lines

        mapped = mapped._replace(reconstruction=below_sight_lines(mapped.reconstruction, task.points))
    _require_heights(mapped.reconstruction)
    mapped = mapped._replace(reconstruction=not_below(mapped.reconstruction, scattered))
    found: dict[str, Any] = {"n_low_returns": n_low} if uses_sight_lines else {}
    if task.blunders:
        found["blunders"] = list(task.blunders)
    return _with_findings(mapped, found)


def _with_sound_points(task: MappingTask) -> MappingTask:
    """Return the task without blunders among its points, which are checked unless they were before."""
    if task.blunders is not None:
        return task
    points, blunders = sound_points(task.points, task.quantity, has_area=task.area is not None)
    return replace(task, points=points, blunders=blunders)


# The four nodes about a place are no farther.
_NEAR_STEPS = 1.5


def not_below(result: Reconstruction, scattered: Contradictions | None) -> Reconstruction:
    """Return a map whose standard deviation about places of contradicting heights is at least their scatter, and its record."""
    if scattered is None:
        return result
    std = result.std
    floor = scattered.floor(std.xy, _NEAR_STEPS * std.step_m).reshape(std.shape)
    raised = Dem.on(std.grid(), np.maximum(std.elevation, floor), std.vertical_datum)
    diagnostics = {**result.diagnostics, "contradictions": [scattered.facts()]}
    return replace(result, std=raised, diagnostics=diagnostics)


def _with_findings(mapped: MappedTerrain, found: dict[str, Any]) -> MappedTerrain:
    """Return the map with findings about its points in the record."""
    if not found:
        return mapped
    diagnostics = {**mapped.reconstruction.diagnostics, **found}
    return mapped._replace(reconstruction=replace(mapped.reconstruction, diagnostics=diagnostics))


def _require_heights(result: Reconstruction) -> Reconstruction:
    """Return a map, or refuse one without a height at any node."""
    if not np.isfinite(result.mean.elevation).any():
        raise InputError(
            "no node of the map got a height; check that points and grid are in the same place and CRS."
        )
    return result


def _require_kinds(method: ReconstructionMethod, configs: Sequence[Section]) -> None:
    """Refuse settings that the method does not read."""
    for config in configs:
        if not isinstance(config, tuple(method.configs.values())):
            kinds = " or ".join(kind.__name__ for kind in method.configs.values()) or "no settings"
            raise TypeError(
                f"the method {method.name} takes {kinds}, and config is a {type(config).__name__}; give settings of "
                "that method or take another one."
            )


def _with_kernel(
    method: ReconstructionMethod, config: Section | None, kernel: Kernel | str
) -> GaussianProcessConfig:
    """Return the settings of a Gaussian process with a kernel."""
    stated = GaussianProcessConfig() if config is None else config
    if not isinstance(stated, GaussianProcessConfig) or "gp" not in method.configs:
        raise TypeError(
            f"the method {method.name} has no kernel; take gp, joint or dense, or leave kernel out."
        )
    change = {"family": kernel, "kernel": None} if isinstance(kernel, str) else {"kernel": kernel}
    return GaussianProcessConfig(**(dict(stated) | change))


def _require_fit(method: ReconstructionMethod, task: MappingTask) -> None:
    """Refuse a task that asks for what the method does not do."""
    if task.path is not None and not method.needs_path:
        able = names_where(m for m in METHODS.values() if m.needs_path)
        raise InputError(
            f"the method {method.name} does not use the path's error; take the method gp or {able}, or leave the path out."
        )
    if task.prior is not None and not method.uses_prior:
        able = names_where(m for m in METHODS.values() if m.uses_prior)
        raise InputError(f"the method {method.name} uses no prior; take {able}, or leave the prior out.")
    if task.quantity != ELEVATION and not method.maps_values:
        able = names_where(m for m in METHODS.values() if m.maps_values)
        raise InputError(
            f"the method {method.name} maps elevations, and {task.quantity} was asked for; take {able}."
        )
    if task.rays and method.sight_lines == "none":
        able = names_where(m for m in METHODS.values() if m.sight_lines == "own")
        raise InputError(
            f"the method {method.name} uses no lines of sight; take {able}, or leave the rays out."
        )


def cut_to_area(result: Reconstruction, area: SurveyArea) -> Reconstruction:
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


logger = logging.getLogger(__name__)


def map_landmarks(
    points: SurfacePoints,
    grid: Grid,
    config: ReconstructionConfig,
    *,
    prior: Dem | None = None,
    path: PathError | None = None,
    quantity: str = ELEVATION,
    progress: Progress | None = None,
    area: SurveyArea | None = None,
    blunders: Sequence[Mapping[str, Any]] | None = None,
) -> MappedTerrain:
    """Map landmarks as the settings say."""
    prior = prior if config.use_prior else None
    method = choose_method(config.method, path, config.landmark_errors)
    if blunders is None:
        points, blunders = sound_points(points, quantity, has_area=area is not None)
    if not method.needs_path:
        points = _prepare(points, prior, config.landmark_errors)
        path = None
    prior = prior if method.uses_prior else None
    configs = config.configs_of(method)
    task = MappingTask(points, grid, prior, path, quantity, configs, config.rays, progress, area, blunders)
    mapped = run_method(method, task)
    return mapped._replace(n_points=len(points))


def _prepare(points: SurfacePoints, prior: Dem | None, landmark_errors: LandmarkErrors) -> SurfacePoints:
    """Return points for a map that takes their errors as independent."""
    if landmark_errors == "independent" and points.own_covariance is not None:
        points = replace(points, covariance=points.own_covariance)
    return points if prior is None else _select_on_prior(points, prior)


def _select_on_prior(points: SurfacePoints, prior: Dem) -> SurfacePoints:
    """Leave out points beyond the prior's edge, where there is nothing to build around, and log their number."""
    same_crs(points.crs, prior.crs, "the points and the prior")
    known = np.isfinite(prior.at(points.xy))
    if not known.any():
        raise InputError(
            f"none of the {len(points)} points lies on the prior; take a prior of the same place, or leave it out."
        )
    if not known.all():
        logger.warning(
            "%d of %d landmarks lie beyond the prior and are left out", (~known).sum(), len(points)
        )
    return points.select(known)


class ScanMap(NamedTuple):
    """A map, and the number of scans that it was made from."""

    reconstruction: Reconstruction
    n_scans: int


def map_scans(
    scans: Iterable[SurfacePoints],
    method: ReconstructionMethod,
    settings: ScanSettings,
    *,
    grid: Grid | None = None,
    on_scan: Callable[[int], None] = lambda _: None,
) -> ScanMap:
    """Map scans one after the other.

    Gross blunders and isolated returns below the ground are left out of every scan, and with lines of sight also returns
    from what overhangs the ground.
    """
    from survey.reconstruction.line_of_sight.returns import ground, without_low_returns

    if method.begin is None:
        raise InputError(f"the method {method.name} maps points, not scans; take field, emap or carving.")
    if settings.rays and method.sight_lines == "none":
        raise InputError(
            f"the method {method.name} uses no lines of sight; take field or carving, or leave the rays out."
        )
    model = method.begin(settings)
    n_scans = n_low_returns = 0
    blunders: list[dict[str, Any]] = []
    seen: list[FloatArray] = []
    for n_scans, scan in enumerate(scans, start=1):
        without_low, n_low = without_low_returns(scan)
        accepted, found = without_blunders(without_low)
        if len(found.rows):
            blunders.append({"scan": n_scans, "sentence": found.sentence(by_row=False), **found.facts()})
        n_low_returns += n_low
        if sum(map(len, seen)) < _MOST_COMPARED:
            seen.append(np.column_stack([accepted.xyz, accepted.sigma_z**2]))
        model.update(accepted.select(ground(accepted.xyz)) if settings.rays else accepted)
        on_scan(n_scans)
    if n_scans == 0:
        raise InputError("there are no scans; at least one is needed.")
    result = model.grid(model.full_grid(settings.step_m) if grid is None else grid)
    result = not_below(result, _between(np.concatenate(seen)))
    diagnostics = {**result.diagnostics, "n_low_returns": n_low_returns}
    if blunders:
        diagnostics["blunders"] = blunders
    return ScanMap(_require_heights(replace(result, diagnostics=diagnostics)), n_scans)


# Points of scans whose places are compared with one another: 100 MB of them.
_MOST_COMPARED = 3_000_000


def _between(seen: FloatArray) -> Contradictions | None:
    """Return the contradictions among the points (N, 4) of all scans: places, heights [m] and variances [m²]."""
    found = Contradictions.among(seen[:, :2], seen[:, 2], seen[:, 3])
    if found is not None:
        logger.warning("%s.", found.sentence())
    return found
