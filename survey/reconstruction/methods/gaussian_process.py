"""Gaussian processes with independent errors: the Fourier engine (gp) and the dense one (dense)."""

from functools import partial
from typing import Literal

from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod


def _run(task: MappingTask, *, engine: Literal["gp", "dense"]) -> MappedTerrain:
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain

    config = task.config(GaussianProcessConfig)
    model = GaussianProcessTerrain(config, task.prior, engine, task.quantity, task.grid.bounds)
    return MappedTerrain(model.fit(task.points).grid(task.grid))


GP = ReconstructionMethod(
    "gp",
    "Gaussian process in Fourier waves, in tiles where the site is large",
    partial(_run, engine="gp"),
    {"gp": GaussianProcessConfig},
    maps_values=True,
)
DENSE = ReconstructionMethod(
    "dense",
    "exact Gaussian process by one dense factorization, for some thousand points",
    partial(_run, engine="dense"),
    {"gp": GaussianProcessConfig},
    maps_values=True,
)
