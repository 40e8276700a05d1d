"""Gaussian-process terrain model: a mean surface and a Gaussian process of the residual.

`GaussianProcessTerrain` is the model with fit, update, predict, sample, save and load. It also gives volumes over a polygon
and their standard deviations; `Volume.minus` is the change between two surveys. `MapWatch` logs the expected time of a
large map. The file of a fitted model holds points, mean, hyperparameters and calibration; `read_model` fits the process to
the points again.
"""

import json
import logging
import math
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt
import shapely
from affine import Affine
from pyproj import CRS
from shapely import MultiPolygon, Polygon

from survey.core import UNSTATED, Bounds, FloatArray, InputError, Progress, checked, parse_json, validated
from survey.core.map_scale import scale_factors
from survey.data import Dem, Grid, SurfacePoints
from survey.io.arrays_file import read_npz, write_npz
from survey.reconstruction.gp.conditioning import ConditioningTask, PriorMeasurements, condition_all
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import EngineName
from survey.reconstruction.gp.families import kernel_facts, kernel_from
from survey.reconstruction.gp.fit import (
    MOST_AT_ONCE,
    Learned,
    SigmaCalibration,
    TerrainFit,
    steepness_on_axes,
)
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters, KernelInAverage, Patch
from survey.reconstruction.gp.mean import ConstantMean, DemMean, Mean
from survey.reconstruction.observations import Observations, Outliers
from survey.reconstruction.prior import ErrorScale, PriorErrors
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction
from survey.reconstruction.terrain_model import Capabilities, TerrainModel, not_fitted


@dataclass(frozen=True)
class Volume:
    """A volume and its standard deviation [m³], and the area it stands on [m²].

    >>> later, earlier = Volume(90.0, 3.0, 10.0), Volume(100.0, 4.0, 10.0)
    >>> later.minus(earlier)
    Volume(mean_m3=-10.0, std_m3=5.0, area_m2=10.0)
    """

    mean_m3: float
    std_m3: float
    area_m2: float

    def minus(self, earlier: "Volume") -> "Volume":
        """Return the change since an earlier survey of the same ground, whose errors are independent.

        Errors that both share, a common satellite prior's where neither survey went,
        cancel in reality; here they are counted twice, which is on the safe side.
        """
        if abs(self.area_m2 - earlier.area_m2) > 1e-6 * self.area_m2:
            raise InputError(
                f"the volumes stand on {self.area_m2:.1f} and {earlier.area_m2:.1f} m²; take the same polygon for both."
            )
        std = float(np.hypot(self.std_m3, earlier.std_m3))
        return Volume(self.mean_m3 - earlier.mean_m3, std, self.area_m2)


def quadrature(polygon: Polygon | MultiPolygon, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes (M, 2) inside a polygon and the area each stands for (M,) [m²]; the areas add up to the polygon's."""
    if polygon.is_empty or not polygon.is_valid or polygon.area <= 0.0:
        raise InputError("the polygon is empty or crosses itself; give a simple one.")
    xmin, ymin, xmax, ymax = polygon.bounds
    # Cell centres, so that a rectangle of whole steps is integrated by the midpoint rule.
    x, y = (
        low
        + (np.arange(max(round((high - low) / step_m), 1)) + 0.5)
        * (high - low)
        / max(round((high - low) / step_m), 1)
        for low, high in ((xmin, xmax), (ymin, ymax))
    )
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = shapely.contains_xy(polygon, nodes[:, 0], nodes[:, 1])
    if not inside.any():
        raise InputError(f"no node lies in the polygon at steps of {step_m:g} m; take a smaller step.")
    return nodes[inside], np.full(int(inside.sum()), polygon.area / inside.sum())


logger = logging.getLogger(__name__)
# The time of smaller maps is not stated, unless they are mapped in tiles.
_N_LARGE = 2_000_000
_N_TIMED = 100_000
# Support codes and calibration, beside the distances to the nearest points.
_BESIDE_DISTANCES = 1.2
# Cross-validation where it is not counted, and writing.
_BESIDE_MAPPING = 1.15


class MapWatch(NamedTuple):
    """Nodes that a map will have, and a progress callback.

    `grid`: nodes of the map. `progress`: progress callback.
    """

    grid: Grid
    progress: Progress | None = None

    def announce(self, learned: Learned, learning_s: float) -> None:
        """Log the expected time of a large map, or of one in tiles.

        `learning_s`: time of learning it, what is still to be learned included [s].
        """
        rows, columns = self.grid.shape
        process = learned.process
        if rows * columns < _N_LARGE and not process.divides_site:
            return
        mapping_s = learned.expected_s(self.grid) + _finishing_s(learned, self.grid)
        text = _time_text(learning_s + _BESIDE_MAPPING * mapping_s)
        if process.divides_site:
            logger.warning(
                "the site is too large for one solve and is mapped in %d tiles, which takes about %s",
                process.record()["n_tiles"],
                text,
            )
        else:
            logger.warning("a map of %d nodes takes about %s", rows * columns, text)


def _finishing_s(learned: Learned, grid: Grid) -> float:
    """Return the expected time of the distances and support codes of all nodes [s]."""
    rows, columns = grid.shape
    n_rows = min(max(_N_TIMED // columns, 1), rows)
    middle = (rows - n_rows) // 2
    nodes = np.stack(np.meshgrid(grid.x, grid.y[middle : middle + n_rows]), axis=-1).reshape(-1, 2)
    began = time.perf_counter()
    learned.nearest_m(nodes[:1])
    prepared = time.perf_counter()
    learned.nearest_m(nodes)
    preparing_s = prepared - began
    over_nodes_s = max(time.perf_counter() - prepared - preparing_s, 0.0) * rows / n_rows
    return _BESIDE_DISTANCES * over_nodes_s + preparing_s * math.ceil(rows * columns / MOST_AT_ONCE)


def _time_text(seconds: float) -> str:
    return f"{seconds / 60.0:.0f} min" if seconds > 90.0 else f"{seconds:.0f} s"


@dataclass(frozen=True)
class GaussianProcessTerrain(TerrainModel):
    """A terrain model: a mean surface, and a Gaussian process for what differs from it.

    `config`: what to assume and what to fit. `prior`: the expected surface; without it a constant or a plane
    by generalised least squares. `engine`: the fast engine or the dense one. `quantity`: what is mapped, with
    its unit. `bounds` (xmin, ymin, xmax, ymax): extent of later predictions [m]; the points' extent by
    default. Points farther from it than its diagonal are not used, and their number is reported. `watch`:
    progress of a map in tiles; with it the expected time of a large map is logged beforehand. `errors`: error model
    of the prior; with it the prior's cells are measurements, and without it the prior is exact. `learned_`:
    state of a fitted model. `vertical_datum_`: vertical datum of the points of a fitted model.

    The terrain is taken to be equally rough everywhere. Errors that points share, such
    as the drift of a trajectory, are not seen.

    >>> rng = np.random.default_rng(1)
    >>> xy = rng.uniform(0.0, 100.0, (60, 2))
    >>> xyz = np.column_stack([xy, 3.0 * np.sin(xy[:, 0] / 20.0)])
    >>> config = GaussianProcessConfig(fit=False, variance_m2=9.0, length_scale_m=25.0)
    >>> model = GaussianProcessTerrain(config).fit(SurfacePoints(xyz, sigma_m=0.05, crs="EPSG:32608"))
    >>> bool(abs(model.predict([[50.0, 50.0]])[0] - 3.0 * np.sin(2.5)) < 0.2)
    True
    """

    capabilities: ClassVar = Capabilities(online=False)

    config: GaussianProcessConfig = field(default_factory=GaussianProcessConfig)
    prior: Dem | Mean | None = None
    engine: EngineName = "gp"
    quantity: str = ELEVATION
    bounds: Bounds | None = None
    watch: MapWatch | None = field(default=None, compare=False, repr=False)
    errors: PriorErrors | None = None
    learned_: Learned | None = field(default=None, repr=False)
    vertical_datum_: str = UNSTATED

    def fit(self, points: SurfacePoints) -> Self:
        """Fit hyperparameters and surface to points, down-weight outliers, and calibrate the standard deviation."""
        fit = self._fit
        near = fit.near(points)
        used = points if near.all() else points.select(near)
        learned = fit.learn(used, np.flatnonzero(near), self._announce)
        learned = replace(learned, n_beyond_reach=int((~near).sum()))
        return replace(self, learned_=learned, vertical_datum_=used.vertical_datum)

    def update(self, points: SurfacePoints) -> Self:
        """Return a model conditioned on these points too, at the same hyperparameters and calibration."""
        known = self._known
        data = Observations.of(points, self.quantity)
        variance = self._fit.through_slope(points, known.process, known.mean, data.variance)
        return replace(self, learned_=known.updated(data.xy, data.z, variance))

    def _height(self, xy: FloatArray) -> FloatArray:
        return self._known.height(xy)

    def _std(self, xy: FloatArray) -> FloatArray:
        return self._known.std(xy)

    def _support(self, xy: FloatArray) -> npt.NDArray[np.uint8]:
        known = self._known
        return known.support(known.std(xy), known.nearest_m(xy))

    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid."""
        known = self._known
        mean, std, support = known.on(grid)
        diagnostics = known.diagnostics()
        covered_share = float(np.isfinite(mean).mean())
        if covered_share == 0.0:
            raise InputError(
                "the prior covers no node of the grid; take a prior of the same place, or leave it out."
            )
        if covered_share < 1.0:
            diagnostics["prior_covered_share"] = covered_share
        return Reconstruction(
            Dem.on(grid, mean, self.vertical_datum_),
            Dem.on(grid, std, self.vertical_datum_),
            support,
            self.engine,
            known.record(),
            quantity=self.quantity,
            diagnostics=diagnostics,
        )

    def sample(self, grid: Grid, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n surfaces (n, H, W) [m] that agree with the points.

        Returns (n, H, W): elevations [m].

        Relief finer than the map (the nugget) and the calibration are not in them.
        """
        surfaces = self._known.process.sample_on_axes(grid.x, grid.y, n, rng)
        return surfaces + self._known.mean.at(grid.xy).reshape(grid.shape)

    def slope(self, grid: Grid) -> tuple[Dem, Dem]:
        """Return the steepness of the map and its standard deviation on a grid [deg].

        Returns: steepness and its standard deviation [deg].

        To first order, for the scales of the map: relief finer than it is steeper.
        """
        known = self._known
        slope, std = steepness_on_axes(known.process, grid.x, grid.y, known.mean.gradient(grid.xy))
        degrees = np.degrees(std / (1.0 + slope**2))
        return Dem.on(grid, np.degrees(np.arctan(slope))), Dem.on(grid, degrees)

    def volume(
        self,
        polygon: Polygon | MultiPolygon,
        *,
        base_m: float = 0.0,
        step_m: float = 2.0,
        crs: CRS | None = None,
    ) -> Volume:
        """Return the volume between the surface and a level, over a polygon.

        The errors of neighbouring places are correlated, and that is in the standard
        deviation, enlarged by the largest calibration factor within the polygon.

        `base_m`: height of the level [m]. `step_m`: spacing of the quadrature [m]; a fraction of the shortest
        length scale. Returns: volume [m³], its standard deviation, and the area [m²].
        """
        known = self._known
        nodes, weights = quadrature(polygon, step_m)
        if crs is not None:
            weights = weights / scale_factors(crs, nodes).areal
        mean, std = known.process.weighted_sum(nodes, weights)
        mean += float(weights @ (known.mean.at(nodes) - base_m))
        factor = float(known.calibration.at(known.nearest_m(nodes)).max())
        return Volume(mean, factor * std, float(weights.sum()))

    def forecast(self, xy: npt.ArrayLike, sigma_m: npt.ArrayLike, grid: Grid) -> FloatArray:
        """Return the standard deviation (H, W) [m] once points at places not yet visited are known.

        No heights are needed. Parameters are the places (N, 2) [m], the standard
        deviations (N,) expected there [m], and where to forecast.

        `xy` (N, 2): places to visit [m]. `sigma_m` (N,): standard deviations expected there [m]. Returns (H,
        W): standard deviation [m].
        """
        places = checked(xy, (None, 2), "the places to visit")
        sigma = np.broadcast_to(np.asarray(sigma_m, dtype=np.float64), (len(places),))
        planned = SurfacePoints(
            np.column_stack([places, self._known.height(places)]), sigma_m=sigma, crs=grid.crs
        )
        return replace(self, quantity=ELEVATION).update(planned)._known.on(grid)[1]

    def save(self, path: str | Path) -> None:
        """Write the model to one ``.npz`` file; a mean that is a function cannot be written."""
        state = TerrainState(
            self.config,
            self.prior,
            self.engine,
            self.quantity,
            self.bounds,
            self.vertical_datum_,
            self._known,
            self.errors,
            self._fit.n_nodes,
        )
        write_model(path, state)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; the factorization is done again, to the same numbers."""
        state = read_model(path)
        model = cls(
            state.config, state.prior, state.engine, state.quantity, state.bounds, errors=state.errors
        )
        return replace(model, learned_=state.learned, vertical_datum_=state.vertical_datum)

    @property
    def _known(self) -> Learned:
        if self.learned_ is None:
            raise not_fitted()
        return self.learned_

    @property
    def _fit(self) -> TerrainFit:
        progress = None if self.watch is None else self.watch.progress
        n_nodes = None if self.watch is None else self.watch.grid.shape[0] * self.watch.grid.shape[1]
        return TerrainFit(
            self.config,
            self.prior,
            self.engine,
            self.quantity,
            self.bounds,
            progress,
            self.errors,
            n_nodes,
        )

    def _announce(self, learned: Learned, learning_s: float) -> None:
        """Log the expected time of a large map."""
        if self.watch is not None:
            self.watch.announce(learned, learning_s)


_FORMAT = "firnline terrain model 2"


class TerrainState(NamedTuple):
    """Everything that a fitted Gaussian-process terrain is made of."""

    config: GaussianProcessConfig
    prior: Dem | Mean | None
    engine: EngineName
    quantity: str
    bounds: Bounds | None
    vertical_datum: str
    learned: Learned
    errors: PriorErrors | None = None
    n_nodes: int | None = None


def write_model(path: str | Path, model: TerrainState) -> None:
    """Write a fitted model; equal models give equal bytes."""
    known = model.learned
    arrays: dict[str, Any] = {
        "xy": known.process.data.xy,
        "values": known.process.data.values,
        "noise_m2": known.own_noise_m2,
        "calibration": np.stack([known.calibration.distance_m, known.calibration.scale]),
        "outlier_rows": known.outliers.index,
        "outlier_z": known.outliers.z,
    }
    facts = {
        "format": _FORMAT,
        "config": model.config.model_dump(mode="json"),
        "engine": model.engine,
        "quantity": model.quantity,
        "bounds": model.bounds,
        "vertical_datum": model.vertical_datum,
        "family": known.hyperparameters.family,
        "nugget_m": known.hyperparameters.nugget_m,
        "log_likelihood": known.hyperparameters.log_likelihood,
        "kernels": [
            one._asdict() | {"kernel": kernel_facts(one.kernel)} for one in known.hyperparameters.kernels
        ],
        "n_nodes": model.n_nodes,
        "errors": None if model.errors is None else model.errors._asdict(),
        "held_out": known.calibration.held_out,
        "treatment": known.outliers.treatment,
        "n_beyond_reach": known.n_beyond_reach,
        **_prior_facts(model.prior, arrays),
    }
    arrays["facts"] = np.frombuffer(json.dumps(facts, sort_keys=True).encode("utf-8"), dtype=np.uint8)
    write_npz(path, arrays, compressed=False)


def _prior_facts(prior: Dem | Mean | None, arrays: dict[str, Any]) -> dict[str, Any]:
    if prior is None:
        return {"prior": "none"}
    if isinstance(prior, ConstantMean):
        return {"prior": "constant", "value_m": prior.value_m}
    if not isinstance(prior, Dem):
        raise InputError("a model whose mean is a function cannot be written; give the prior as a Dem.")
    arrays["prior"] = prior.elevation
    return {
        "prior": "dem",
        "transform": list(prior.transform)[:6],
        "crs": prior.crs.to_wkt(),
        "datum": prior.vertical_datum,
    }


def read_model(path: str | Path) -> TerrainState:
    """Read what `write_model` wrote, and condition on its points again."""
    arrays = read_npz(path, "the terrain model", "save it again")
    try:
        facts: dict[str, Any] = parse_json(
            arrays["facts"].tobytes(), f"the terrain model {path}", "save it again"
        )
        if facts["format"] != _FORMAT:
            raise InputError(f"{path} has the format {facts['format']!r}; {_FORMAT!r} was expected.")
    except InputError:
        raise
    except (ValueError, KeyError) as error:
        raise InputError(f"{path} is no terrain model ({error}); save it again.") from error
    return _rebuilt(arrays, facts)


def _rebuilt(arrays: dict[str, Any], facts: dict[str, Any]) -> TerrainState:
    config = validated(GaussianProcessConfig, facts["config"], "the terrain model's settings")
    prior = _prior_of(facts, arrays)
    found = _hyperparameters(facts)
    errors = _errors(facts["errors"])
    measured = PriorMeasurements(prior, errors) if errors and isinstance(prior, Dem) else None
    task = ConditioningTask(
        facts["engine"],
        config,
        tuple(facts["bounds"]) if facts["bounds"] else None,
        config.trend(has_prior=prior is not None and measured is None),
        measured,
        facts["n_nodes"],
    )
    conditioned = condition_all(task, found, arrays["xy"], arrays["values"], arrays["noise_m2"])
    mean: Mean = prior if isinstance(prior, ConstantMean) else ConstantMean(0.0)
    if isinstance(prior, Dem) and measured is None:
        mean = DemMean(prior, config.prior_interpolation)
    distance, scale = arrays["calibration"]
    calibration = SigmaCalibration(distance, scale, facts["held_out"])
    outliers = Outliers(arrays["outlier_rows"], arrays["outlier_z"], facts["treatment"])
    learned = Learned(*conditioned, mean, found, calibration, outliers, facts["n_beyond_reach"])
    bounds = tuple(facts["bounds"]) if facts["bounds"] else None
    return TerrainState(
        config, prior, facts["engine"], facts["quantity"], bounds, facts["vertical_datum"], learned, errors
    )


def _hyperparameters(facts: dict[str, Any]) -> Hyperparameters:
    kernels = [_kernel_in_average(one) for one in facts["kernels"]]
    return Hyperparameters(
        facts["family"], kernels[0].kernel, facts["nugget_m"], facts["log_likelihood"], average=tuple(kernels)
    )


def _kernel_in_average(facts: dict[str, Any]) -> KernelInAverage:
    patch = facts["patch"]
    if patch is not None:
        number, centres, width = patch
        patch = Patch(number, tuple((x, y) for x, y in centres), (width[0], width[1]))
    return KernelInAverage(**facts | {"kernel": kernel_from(facts["kernel"]), "patch": patch})


def _errors(facts: dict[str, Any] | None) -> PriorErrors | None:
    if facts is None:
        return None
    scales = {name: ErrorScale(*facts[name]) for name in ("white", "correlated")}
    return PriorErrors(**facts | scales)


def _prior_of(facts: dict[str, Any], arrays: dict[str, Any]) -> Dem | ConstantMean | None:
    if facts["prior"] == "dem":
        return Dem(arrays["prior"], Affine(*facts["transform"]), facts["crs"], facts["datum"])
    return ConstantMean(facts["value_m"]) if facts["prior"] == "constant" else None
