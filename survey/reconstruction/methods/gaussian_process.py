"""Gaussian processes with independent errors: the Fourier engine (gp) and the dense one (dense)."""

from functools import partial

from survey.reconstruction.capacity import require_length_scale
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.process import EngineName
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    ReconstructionMethod,
    ScanSettings,
    config_of,
)


def check_length_scale(settings: ScanSettings) -> None:
    """Refuse stated length scales far below the step of the map."""
    if settings.step_m is not None:
        config = config_of(settings.configs, GaussianProcessConfig)
        require_length_scale(config.stated_length_m, settings.step_m)


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
    check=check_length_scale,
)
DENSE = ReconstructionMethod(
    "dense",
    "exact Gaussian process by one dense factorization, for some thousand points",
    partial(_run, engine="dense"),
    {"gp": GaussianProcessConfig},
    maps_values=True,
    check=check_length_scale,
)
