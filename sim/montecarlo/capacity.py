"""Sizes that a Monte Carlo study accepts, checked before the first trial."""

from sim.mission.capacity import require_terrain_cells
from sim.montecarlo.blocks import trials_together
from sim.montecarlo.config import RandomKind, StudyConfig
from survey.core.errors import CapacityError
from survey.reconstruction.capacity import smallest_step_m

MOST_ROWS = 100_000_000
"""Rows of the table of trials; about 100 bytes each."""
MOST_CELLS_TOGETHER = 200_000_000
"""Cells of all terrains of a block, 8 bytes each."""
MOST_NODES = 1_000_000
"""Nodes at which a map is judged."""


def require_study(study: StudyConfig) -> None:
    """Refuse a study whose table, terrains or maps would not fit.

    Parameters
    ----------
    study : StudyConfig
        The study.

    Raises
    ------
    CapacityError
        Names the setting and a value that would pass.
    """
    per_trial = len(study.terrains) * len(study.designs) * len(study.maps)
    if study.trials * per_trial > MOST_ROWS:
        raise CapacityError(
            f"{study.trials} trials give {study.trials * per_trial:.3g} rows, and {MOST_ROWS} can be stored; "
            f"set trials to at most {MOST_ROWS // per_trial}."
        )
    together = min(trials_together(study), study.trials)
    for kind in study.terrains:
        if isinstance(kind, RandomKind):
            require_terrain_cells(kind.size_m, kind.size_m, kind.step_m, MOST_CELLS_TOGETHER // together)
            _require_nodes(kind.size_m, study.map_step_m)


def _require_nodes(size_m: float, step_m: float) -> None:
    """Refuse more nodes than maps can be judged at."""
    n_nodes = (size_m / step_m) ** 2
    if n_nodes > MOST_NODES:
        smallest = smallest_step_m(size_m, size_m, MOST_NODES)
        raise CapacityError(
            f"map_step_m = {step_m:g} gives {n_nodes:.3g} nodes on {size_m:g} m, and maps can be judged at {MOST_NODES}; "
            f"set it to {smallest:g} or more."
        )
