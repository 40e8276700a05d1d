"""Spring lattice of the EMap paper (emap)."""

from typing import TYPE_CHECKING

from survey.reconstruction.lattice.config import SpringLatticeConfig
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    ReconstructionMethod,
    ScanSettings,
    config_of,
)

if TYPE_CHECKING:
    from survey.reconstruction.lattice.spring_lattice import SpringLattice


def _begin(settings: ScanSettings) -> "SpringLattice":
    from survey.reconstruction.lattice.spring_lattice import SpringLattice

    config = config_of(settings.configs, SpringLatticeConfig)
    # The paper's lattice follows the sensor; a map of everything grows with the points.
    side_m = config.side_m if "side_m" in config.model_fields_set else None
    changes = {"step_m": config.step_m or settings.step_m, "side_m": side_m}
    return SpringLattice(config.model_copy(update=changes))


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
)
