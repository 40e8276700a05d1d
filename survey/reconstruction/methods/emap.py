"""Spring lattice of the EMap paper (emap)."""

from typing import TYPE_CHECKING

import numpy as np

from survey.reconstruction.lattice.config import SpringLatticeConfig
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    ReconstructionMethod,
    ScanSettings,
)

if TYPE_CHECKING:
    from survey.reconstruction.lattice.spring_lattice import SpringLattice


def _begin(settings: ScanSettings) -> "SpringLattice":
    from survey.reconstruction.lattice.spring_lattice import SpringLattice

    config = settings.configs.get(SpringLatticeConfig)
    # The paper's lattice follows the sensor; a map of everything grows with the points.
    side_m = config.side_m if "side_m" in config.model_fields_set else None
    changes = {"step_m": config.step_m or settings.step_m, "side_m": side_m}
    return SpringLattice(config.model_copy(update=changes))


def _check_cover(settings: ScanSettings) -> None:
    """Refuse a lattice with more nodes than fit into memory."""
    from survey.reconstruction.lattice.spring_lattice import BYTES_PER_NODE
    from survey.reconstruction.nodes import NodeWindow, require_room

    config = _begin(settings).config
    if settings.bounds is None:
        return
    xmin, ymin, xmax, ymax = settings.bounds
    if config.side_m is None:
        window = NodeWindow.over(settings.bounds, config.node_step_m)
    else:
        centre = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
        window = NodeWindow.around(centre, config.side_m, config.node_step_m)
    require_room(window, BYTES_PER_NODE, config.memory_mb)


def _run(task: MappingTask) -> MappedTerrain:
    settings = ScanSettings(task.grid.step_m, task.grid.bounds, task.rays, task.configs)
    return MappedTerrain(_begin(settings).fit(task.points).grid(task.grid))


EMAP = ReconstructionMethod(
    "emap",
    "springs between nodes, scan by scan (EMap)",
    _run,
    {"emap": SpringLatticeConfig},
    _begin,
    sight_lines="none",
    uses_prior=False,
    bytes_per_node=300.0,
    check_cover=_check_cover,
)
