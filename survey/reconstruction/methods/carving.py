"""Space-carving kernels (carving)."""

from typing import TYPE_CHECKING

from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    ReconstructionMethod,
    ScanSettings,
)

if TYPE_CHECKING:
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

# Kernels are 0.4 m wide at least: more points than this make them slower, not better.
_THIN_M = 0.1


def _begin(settings: ScanSettings) -> "SpaceCarvingKernel":
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

    config = settings.configs.get(SpaceCarvingConfig)
    if "thin_m" not in config.model_fields_set:
        config = config.model_copy(update={"thin_m": _THIN_M})
    return SpaceCarvingKernel(config)


def _check_cover(settings: ScanSettings) -> None:
    """Refuse kernels that do not fit into memory."""
    from survey.reconstruction.carving.config import require_room

    if settings.bounds is None:
        return
    config = settings.configs.get(SpaceCarvingConfig)
    xmin, ymin, xmax, ymax = settings.bounds
    reach_m = 2.0 * config.first_length_m
    require_room(config, xmax - xmin + reach_m, ymax - ymin + reach_m, 0)


def _run(task: MappingTask) -> MappedTerrain:
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

    model = SpaceCarvingKernel(task.config(SpaceCarvingConfig))
    return MappedTerrain(model.fit(task.points).grid(task.grid))


CARVING = ReconstructionMethod(
    "carving",
    "compact kernels that stay below lines of sight",
    _run,
    {"carving": SpaceCarvingConfig},
    _begin,
    sight_lines="own",
    uses_prior=False,
    bytes_per_node=200.0,
    check_cover=_check_cover,
)
