"""Gaussian processes with independent errors: the Fourier engine (gp) and the dense one (dense)."""

from functools import partial

from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.process import EngineName
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod


def _run(task: MappingTask, *, engine: EngineName) -> MappedTerrain:
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain, MapWatch

    config = task.config(GaussianProcessConfig)
    rows, columns = task.grid.shape
    watch = MapWatch(rows * columns, task.progress)
    model = GaussianProcessTerrain(config, task.prior, engine, task.quantity, task.grid.bounds, watch)
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
