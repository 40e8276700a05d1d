"""Methods that map scan by scan: a Gaussian field (field), springs (emap), and space-carving kernels (carving).

Each begins a model that takes scans one after the other; a map of points is a map of one scan. Models are imported when
they begin, because numba takes half a second.
"""

from typing import TYPE_CHECKING

import numpy as np

from survey.core import InputError
from survey.reconstruction.carving.config import SpaceCarvingConfig, require_kernel_memory
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod, ScanSettings
from survey.reconstruction.nodes import NodeWindow, require_room

if TYPE_CHECKING:
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
    from survey.reconstruction.lattice.field_lattice import FieldLattice
    from survey.reconstruction.lattice.spring_lattice import SpringLattice


def _begin_field(settings: ScanSettings) -> "FieldLattice":
    from survey.reconstruction.lattice.field_lattice import FieldLattice

    config = settings.configs.get(FieldLatticeConfig)
    changes = {"step_m": config.step_m or settings.step_m, "rays": config.rays or settings.rays}
    return FieldLattice(config.model_copy(update=changes), settings.bounds)


def _check_field(settings: ScanSettings) -> None:
    """Refuse a lattice with more nodes than fit into memory."""
    config = settings.configs.get(FieldLatticeConfig)
    if settings.bounds is not None:
        step_m = config.step_m or settings.step_m or config.node_step_m
        require_room(NodeWindow.over(settings.bounds, step_m), config.bytes_per_node, config.memory_mb)


def _run_field(task: MappingTask) -> MappedTerrain:
    xmin, ymin, xmax, ymax = task.grid.bounds
    x, y = task.points.xy.T
    if not ((x >= xmin) & (x <= xmax) & (y >= ymin) & (y <= ymax)).any():
        raise InputError(
            f"none of the {len(x)} points lies on the grid; check that points and grid are in the same place and CRS."
        )
    settings = ScanSettings(task.grid.step_m, task.grid.bounds, task.rays, task.configs)
    return MappedTerrain(_begin_field(settings).fit(task.points).grid(task.grid))


FIELD = ReconstructionMethod(
    "field",
    "Gaussian field on a lattice, scan by scan, with bounds from lines of sight",
    _run_field,
    {"field": FieldLatticeConfig},
    _begin_field,
    sight_lines="own",
    uses_prior=False,
    bytes_per_node=500.0,
    check=_check_field,
)


def _begin_emap(settings: ScanSettings) -> "SpringLattice":
    from survey.reconstruction.lattice.spring_lattice import SpringLattice

    config = settings.configs.get(SpringLatticeConfig)
    # The paper's lattice follows the sensor; a map of everything grows with the points.
    side_m = config.side_m if "side_m" in config.model_fields_set else None
    changes = {"step_m": config.step_m or settings.step_m, "side_m": side_m}
    return SpringLattice(config.model_copy(update=changes))


def _check_emap(settings: ScanSettings) -> None:
    """Refuse a lattice with more nodes than fit into memory."""
    from survey.reconstruction.lattice.spring_lattice import BYTES_PER_NODE

    config = _begin_emap(settings).config
    if settings.bounds is None:
        return
    xmin, ymin, xmax, ymax = settings.bounds
    if config.side_m is None:
        window = NodeWindow.over(settings.bounds, config.node_step_m)
    else:
        centre = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
        window = NodeWindow.around(centre, config.side_m, config.node_step_m)
    require_room(window, BYTES_PER_NODE, config.memory_mb)


def _run_emap(task: MappingTask) -> MappedTerrain:
    settings = ScanSettings(task.grid.step_m, task.grid.bounds, task.rays, task.configs)
    return MappedTerrain(_begin_emap(settings).fit(task.points).grid(task.grid))


EMAP = ReconstructionMethod(
    "emap",
    "springs between nodes, scan by scan (EMap)",
    _run_emap,
    {"emap": SpringLatticeConfig},
    _begin_emap,
    sight_lines="none",
    uses_prior=False,
    bytes_per_node=300.0,
    check_cover=_check_emap,
)


# Kernels are 0.4 m wide at least: more points than this make them slower, not better.
_THIN_M = 0.1


def _begin_carving(settings: ScanSettings) -> "SpaceCarvingKernel":
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

    config = settings.configs.get(SpaceCarvingConfig)
    if "thin_m" not in config.model_fields_set:
        config = config.model_copy(update={"thin_m": _THIN_M})
    return SpaceCarvingKernel(config)


def _check_carving(settings: ScanSettings) -> None:
    """Refuse kernels that do not fit into memory."""
    if settings.bounds is None:
        return
    config = settings.configs.get(SpaceCarvingConfig)
    xmin, ymin, xmax, ymax = settings.bounds
    reach_m = 2.0 * config.first_length_m
    require_kernel_memory(config, xmax - xmin + reach_m, ymax - ymin + reach_m, 0)


def _run_carving(task: MappingTask) -> MappedTerrain:
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

    model = SpaceCarvingKernel(task.config(SpaceCarvingConfig))
    return MappedTerrain(model.fit(task.points).grid(task.grid))


CARVING = ReconstructionMethod(
    "carving",
    "compact kernels that stay below lines of sight",
    _run_carving,
    {"carving": SpaceCarvingConfig},
    _begin_carving,
    sight_lines="own",
    uses_prior=False,
    bytes_per_node=200.0,
    check_cover=_check_carving,
)
