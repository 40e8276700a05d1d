"""Gridders with their defaults: firnline without and with a prior, and other packages where they are installed.

Kriging and splines get the places from their mean, for they lose digits of coordinates of millions of metres. Linear and
Clough-Tocher interpolation take the nearest sample beyond the hull. Start of the fits of scikit-learn: a length of 50 m
between 1 m and 10 km, heights of unit variance, and the variance of each sample known.
"""

import json
import shutil
import subprocess
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import rasterio
from scipy.interpolate import (
    CloughTocher2DInterpolator,
    LinearNDInterpolator,
    NearestNDInterpolator,
    RBFInterpolator,
)

from benchmarks.gridders_on_real_ground.surveys import Survey
from survey import SurfacePoints
from survey.core.arrays import FloatArray
from survey.reconstruction import reconstruct


class Surface(NamedTuple):
    """Heights (M,) of the nodes, and their standard deviations (M,) where the gridder states them [m]."""

    mean: FloatArray
    std: FloatArray | None = None


@dataclass(frozen=True)
class Gridder:
    """A gridder: its name, the module or program that it needs, and how it maps a survey."""

    name: str
    needs: str
    map: Callable[[Survey], Surface]

    @property
    def is_installed(self) -> bool:
        """Whether the module or program is here."""
        return shutil.which(self.needs) is not None or find_spec(self.needs) is not None


def firnline(survey: Survey, *, with_prior: bool = False) -> Surface:
    """Map by `reconstruct` with its defaults."""
    points = SurfacePoints(
        np.column_stack([survey.xy, survey.z]), sigma_m=survey.sigma_m, crs=survey.grid.crs
    )
    made = reconstruct(points, survey.grid, survey.prior if with_prior else None)
    return Surface(made.mean.elevation.ravel(), made.std.elevation.ravel())


def _centred(survey: Survey) -> tuple[FloatArray, FloatArray]:
    """Return the places of the samples (N, 2) and of the nodes (M, 2) from the mean of the samples [m]."""
    centre = survey.xy.mean(axis=0)
    return survey.xy - centre, survey.grid.xy - centre


def _scikit_learn(survey: Survey, kernel: str, **settings: float) -> Surface:
    process, kernels = (
        import_module("sklearn.gaussian_process"),
        import_module("sklearn.gaussian_process.kernels"),
    )
    mean, scale = survey.z.mean(), survey.z.std()
    xy, nodes = _centred(survey)
    shape = getattr(kernels, kernel)(length_scale=50.0, length_scale_bounds=(1.0, 1e4), **settings)
    model = process.GaussianProcessRegressor(
        kernels.ConstantKernel(1.0, (1e-4, 1e4)) * shape, alpha=(survey.sigma_m / scale) ** 2
    )
    height, std = model.fit(xy, (survey.z - mean) / scale).predict(nodes, return_std=True)
    return Surface(height * scale + mean, std * scale)


def _triangles(survey: Survey, interpolator: type) -> Surface:
    xy, nodes = _centred(survey)
    height = interpolator(xy, survey.z)(nodes)
    return Surface(np.where(np.isfinite(height), height, NearestNDInterpolator(xy, survey.z)(nodes)))


def _thin_plate(survey: Survey) -> Surface:
    xy, nodes = _centred(survey)
    return Surface(RBFInterpolator(xy, survey.z, neighbors=min(80, len(xy)))(nodes))


def _verde(survey: Survey) -> Surface:
    xy, nodes = _centred(survey)
    return Surface(import_module("verde").Spline().fit(tuple(xy.T), survey.z).predict(tuple(nodes.T)))


def _pykrige(survey: Survey) -> Surface:
    xy, nodes = _centred(survey)
    tool = import_module("pykrige.ok").OrdinaryKriging(*xy.T, survey.z, variogram_model="spherical")
    mean, variance = tool.execute("points", *nodes.T)
    return _with_std(mean, variance)


def _gstools(survey: Survey, model: str) -> Surface:
    gstools = import_module("gstools")
    xy, nodes = _centred(survey)
    fitted = getattr(gstools, model)(dim=2)
    fitted.fit_variogram(*gstools.vario_estimate(xy.T, survey.z))
    # The pseudo-inverse takes forty times as long, and is for samples that stand twice.
    mean, variance = gstools.krige.Ordinary(fitted, xy.T, survey.z, pseudo_inv=False)(nodes.T)
    return _with_std(mean, variance)


def _with_std(mean: Any, variance: Any) -> Surface:
    """Return a kriged surface; rounding makes variances at samples negative, or 0."""
    return Surface(np.asarray(mean), np.sqrt(np.maximum(np.asarray(variance), 1e-8)))


def _gdal_grid(survey: Survey, algorithm: str) -> Surface:
    xy, _ = _centred(survey)
    west, south, east, north = np.array(survey.grid.bounds) - np.tile(survey.xy.mean(axis=0), 2)
    half_m, (rows, columns) = 0.5 * survey.grid.step_m, survey.grid.shape
    points = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [*place, height]}}
        for place, height in zip(xy.tolist(), survey.z.tolist(), strict=True)
    ]
    with TemporaryDirectory() as folder:
        source, made = Path(folder, "points.geojson"), Path(folder, "made.tif")
        source.write_text(json.dumps({"type": "FeatureCollection", "features": points}), encoding="utf-8")
        extent = [
            "-txe",
            str(west - half_m),
            str(east + half_m),
            "-tye",
            str(north + half_m),
            str(south - half_m),
        ]
        command = ["gdal_grid", "-q", "-a", algorithm, *extent, "-outsize", str(columns), str(rows)]
        subprocess.run([*command, "-ot", "Float64", source, made], check=True, capture_output=True)
        with rasterio.open(made) as file:
            return Surface(file.read(1).ravel())


OURS = (
    Gridder("firnline", "survey", firnline),
    Gridder("firnline, prior", "survey", partial(firnline, with_prior=True)),
)
MATERN = "scikit-learn Matern 3/2"
PEERS = (
    Gridder("scikit-learn RBF", "sklearn", partial(_scikit_learn, kernel="RBF")),
    Gridder(MATERN, "sklearn", partial(_scikit_learn, kernel="Matern", nu=1.5)),
    Gridder("scikit-learn Matern 5/2", "sklearn", partial(_scikit_learn, kernel="Matern", nu=2.5)),
    Gridder("SciPy linear", "scipy", partial(_triangles, interpolator=LinearNDInterpolator)),
    Gridder("SciPy Clough-Tocher", "scipy", partial(_triangles, interpolator=CloughTocher2DInterpolator)),
    Gridder("SciPy thin plate", "scipy", _thin_plate),
    Gridder("verde Spline", "verde", _verde),
    Gridder("PyKrige spherical", "pykrige", _pykrige),
    Gridder("GSTools exponential", "gstools", partial(_gstools, model="Exponential")),
    Gridder("GSTools spherical", "gstools", partial(_gstools, model="Spherical")),
    Gridder("gdal_grid invdist", "gdal_grid", partial(_gdal_grid, algorithm="invdist")),
    Gridder("gdal_grid linear", "gdal_grid", partial(_gdal_grid, algorithm="linear")),
)


def quietly(gridder: Gridder, survey: Survey) -> Surface:
    """Map without the warnings of fits that end at a limit."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return gridder.map(survey)
