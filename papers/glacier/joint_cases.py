"""Site, errors and cases of the joint map study."""

from dataclasses import dataclass, field
from typing import Any, Literal

from survey.core.crs.checks import projected_crs
from survey.data.area import SurveyArea
from survey.data.grid import Grid
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.prior import SatelliteErrors

CRS = projected_crs("EPSG:32608", "the study")
SIDE_M, RELIEF_M, MICRO_RELIEF_M = 600.0, 25.0, 0.15
AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
NODES = Grid((3.75, 3.75, 596.25, 596.25), 7.5, CRS)
ODOMETRY: dict[str, Any] = {
    "yaw_sigma_deg": 0.5,
    "tilt_sigma_deg": 0.4,
    "scale_sigma": 0.012,
    "step_sigma_m": 0.012,
}
RECEIVER: dict[str, Any] = {"gps_bias_sigma_m": 3.0, "gps_white_sigma_m": 1.0}
ASSUMED_TAU_S = 300.0
"""Correlation time of the receiver that the estimator assumes: the longer one is the safer."""
KERNEL = GaussianProcessConfig(
    fit=False,
    family="two-scale",
    variance_m2=9.0,
    length_scale_m=140.0,
    second_variance_m2=0.25,
    second_length_scale_m=55.0,
    nugget_m=MICRO_RELIEF_M,
    mean="plane",
    tolerance_m=5e-3,
)
STATED = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=1.0))
"""Error of the satellite prior as its product states it."""


@dataclass(frozen=True)
class Case:
    """One way to survey and to map."""

    name: str
    errors: Literal["independent", "inflated", "joint"] = "joint"
    satellite: bool = True
    aids: dict[str, Any] = field(default_factory=lambda: {"barometer": False})
    satellite_offset_m: float = 0.0
    assumed: dict[str, Any] = field(default_factory=dict)
    joint: JointConfig = STATED
    gp: GaussianProcessConfig = KERNEL
    swaths: int = 4
    tie_lines: int = 0


GRAVITY = {"accelerometer": True, "barometer": True}
STAKES = {**GRAVITY, "stakes": 4}
CASES = (
    Case("per-landmark noise", "independent", satellite=False),
    Case("inflated noise", "inflated", satellite=False),
    Case("joint", satellite=False),
    Case("joint + satellite"),
    Case("+ gravity, barometer", aids=GRAVITY),
    Case("+ 4 stakes", aids=STAKES),
)
"""The steps of the comparison."""
