"""Blocks of Monte Carlo trials, and the row of the table that each trial gives.

Surveys of one route share the factorization of their maps, so trials come in blocks. A block is
what one worker does at a time and what is stored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from sim.montecarlo.config import StudyConfig

_TOGETHER = {"ideal": 50, "statistical": 1}


class TrialBlock(NamedTuple):
    """Trials ``first`` to ``first + n - 1`` on the terrain of this number in the study."""

    terrain: int
    first: int
    n: int

    @property
    def name(self) -> str:
        """Name of the block's file."""
        return f"{self.terrain:03d}-{self.first:07d}"


def trials_together(study: StudyConfig) -> int:
    """Return the number of trials in a block."""
    return _TOGETHER[study.fidelity]


def blocks_of(study: StudyConfig) -> list[TrialBlock]:
    """Return the blocks of a study in the order of its table."""
    size = trials_together(study)
    return [
        TrialBlock(terrain, first, min(size, study.trials - first))
        for terrain in range(len(study.terrains))
        for first in range(0, study.trials, size)
    ]


@dataclass(frozen=True)
class Trial:
    """One line of the table: a survey of one terrain, and how good its map is.

    ``claimed_m`` is the root mean square of the map's own standard deviation; ``silent_share`` the share of
    nodes without a height. Lengths are metres.
    """

    terrain: str
    trial: int
    planner: str
    swaths: int
    map: str
    length_m: float
    n_samples: int
    rmse_m: float
    bias_m: float
    p95_m: float
    worst_m: float
    claimed_m: float
    silent_share: float
    family: str
    length_scale_m: float
    sd_m: float


def as_columns(trials: Sequence[Trial]) -> dict[str, list[Any]]:
    """Return the table's columns."""
    names = Trial.__dataclass_fields__
    return {name: [getattr(trial, name) for trial in trials] for name in names}
