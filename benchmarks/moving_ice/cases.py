"""Surveys that are compared: their ice, their errors, and what the estimate assumes of both.

All errors are drawn as the estimate assumes them: those of fixes, odometry and stakes, of the surveyed start, the tilt of the
camera's mounting, the heights that landmarks of a stretch share, the bias of far landmarks, and the melt.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.config.mission import MissionConfig
from survey.core.config import validated
from survey.core.streams import stream
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from vision_slam import LocalizationConfig

SIDE_M, EDGE_M, SWATHS = 100.0, 40.0, 4
MELT_M_PER_DAY, MELT_SIGMA_M_PER_DAY = 0.06, 0.02
_WEST, _SOUTH = 526000.0, 6478000.0
_POSES = 1440
_ASSUMED, _MAP = LocalizationConfig(), JointConfig()
TERRAIN = GaussianProcessConfig(
    fit=False, family="matern-5/2", variance_m2=16.0, length_scale_m=40.0, nugget_m=0.0
)
"""Kernel that the drawn terrain has; it has no relief that is finer."""


@dataclass(frozen=True)
class Case:
    """A survey: velocity on the centre line [m/day], duration [h], number of stakes, flow and share of the daily cycle.

    `ground` is the family of the drawn terrain; where it is not that of `TERRAIN`, the map finds its kernel.
    """

    velocity: float
    hours: float
    n_stakes: int
    seed: int
    flow: str = "uniform"
    diurnal_share: float = 0.0
    has_planes: bool = False
    ground: str = "matern-5/2"

    @property
    def name(self) -> str:
        """Name of the case's file."""
        kind = f"{self.flow}-{self.diurnal_share:g}-{'planes' if self.has_planes else 'one'}"
        return f"{self.velocity:g}-{self.hours:g}h-{self.n_stakes}-{kind}-{self.ground.replace('/', '_')}-{self.seed}"

    @property
    def kernel(self) -> GaussianProcessConfig:
        """How the map finds its kernel."""
        return TERRAIN if self.ground == TERRAIN.family else GaussianProcessConfig()


def mission_of(case: Case) -> MissionConfig:
    """Return the mission of a case; that of still ice has neither velocity nor melt."""
    low, high = _WEST + EDGE_M, _WEST + EDGE_M + SIDE_M
    length_m = SWATHS * SIDE_M + SIDE_M
    settings: dict[str, Any] = {
        "schema_version": 1,
        "name": "moving-ice",
        "seed": case.seed,
        "terrain": {
            "source": "random",
            "family": case.ground,
            "length_scale_m": 40.0,
            "size_m": SIDE_M + 2.0 * EDGE_M,
            "relief_m": 16.0,
            "origin_m": (_WEST, _SOUTH),
        },
        "area": {"bounds_m": (low, _SOUTH + EDGE_M, high, _SOUTH + EDGE_M + SIDE_M)},
        "planner": {"pattern": "lawnmower", "swaths": SWATHS},
        "rover": {"speed_m_s": length_m / (3600.0 * case.hours)},
        "aids": {"stakes": case.n_stakes, "stake_sigma_m": 0.03, "recognition": 0.5, "base_station": True},
        "ice": _ice(case),
        "sensors": _errors(case.seed),
    }
    return validated(MissionConfig, settings, "the mission")


def _ice(case: Case) -> dict[str, Any]:
    """Return the motion of the ice and what is assumed of it; its melt is drawn from the assumption."""
    expected = MELT_M_PER_DAY if case.velocity else 0.0
    melt = expected + MELT_SIGMA_M_PER_DAY * stream(case.seed, "melt").standard_normal()
    return {
        "velocity_m_per_day": case.velocity,
        "direction_deg": np.random.default_rng(case.seed).uniform(0.0, 360.0),
        "flow": case.flow,
        "half_width_m": 150.0,
        "melt_m_per_day": max(melt, 0.0) if case.velocity else 0.0,
        "diurnal_share": case.diurnal_share,
        "pose_interval_s": 3600.0 * case.hours / _POSES,
        "stake_surveys": 4,
        "assumed": {
            "lowering_m_per_day": expected,
            "lowering_sigma_m_per_day": MELT_SIGMA_M_PER_DAY,
            "velocity_change_sigma_m_per_day_km": 5.0 if case.has_planes else 0.0,
        },
    }


def _errors(seed: int) -> dict[str, float]:
    """Return errors of the sensors that the estimate assumes and a mission does not draw unless it states them."""
    return {
        "tilt_bias_sigma_deg": _ASSUMED.tilt_bias_sigma_deg,
        "landmark_shared_sigma_m": _MAP.landmark_shared_sigma_m,
        "landmark_far_bias_m": _MAP.far_bias_sigma_m * stream(seed, "far bias").standard_normal(),
    }
