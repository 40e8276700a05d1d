"""Gaussian field on a lattice (field)."""

from typing import TYPE_CHECKING

from survey.core.errors import InputError
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    ReconstructionMethod,
    ScanSettings,
)

if TYPE_CHECKING:
    from survey.reconstruction.lattice.field_lattice import FieldLattice


def _begin(settings: ScanSettings) -> "FieldLattice":
    from survey.reconstruction.lattice.field_lattice import FieldLattice

    config = settings.configs.get(FieldLatticeConfig)
    changes = {"step_m": config.step_m or settings.step_m, "rays": config.rays or settings.rays}
    return FieldLattice(config.model_copy(update=changes), settings.bounds)


def _check(settings: ScanSettings) -> None:
    """Refuse a lattice with more nodes than fit into memory."""
    from survey.reconstruction.nodes import NodeWindow, require_room

    config = settings.configs.get(FieldLatticeConfig)
    if settings.bounds is not None:
        step_m = config.step_m or settings.step_m or config.node_step_m
        require_room(NodeWindow.over(settings.bounds, step_m), config.bytes_per_node, config.memory_mb)


def _run(task: MappingTask) -> MappedTerrain:
    xmin, ymin, xmax, ymax = task.grid.bounds
    x, y = task.points.xy.T
    if not ((x >= xmin) & (x <= xmax) & (y >= ymin) & (y <= ymax)).any():
        raise InputError(
            f"none of the {len(x)} points lies on the grid; check that points and grid are in the same place and CRS."
        )
    settings = ScanSettings(task.grid.step_m, task.grid.bounds, task.rays, task.configs)
    return MappedTerrain(_begin(settings).fit(task.points).grid(task.grid))


FIELD = ReconstructionMethod(
    "field",
    "Gaussian field on a lattice, scan by scan, with bounds from lines of sight",
    _run,
    {"field": FieldLatticeConfig},
    _begin,
    sight_lines="own",
    uses_prior=False,
    bytes_per_node=500.0,
    check=_check,
)
