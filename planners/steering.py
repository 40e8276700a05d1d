"""Steering of patterns that are decided while driving, from the sensed attitude.

`Attitude` is the slope along and across a rover; `attitude_sensor` computes it on known terrain for simulation. A
`Steering` chooses the next heading of each rover from it. `ConfiguredSteering` is the base class of those that are set
by a `SteeredConfig`: every step has a row of candidate headings about the swath's. The paths that result are computed
in `planners.steered_paths`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from planners.config import SwathConfig
from survey import Dem, InputError
from survey.core import FloatArray, IntArray


class SteeredConfig(SwathConfig):
    """Swaths that the rover deviates from while it drives."""

    step_m: PositiveFloat = 10.0
    """Distance driven between two decisions [m]."""
    candidates_deg: tuple[float, ...] = Field(default=(-45.0, 0.0, 45.0), min_length=1, strict=False)
    """Headings to choose from, counter-clockwise from the swath's, within 80° of it [deg]."""
    toggle_probability: float = Field(default=0.1, ge=0.0, le=1.0)
    """Chance per step that the rule is switched."""
    band_share: float = Field(default=0.5, ge=0.0, le=0.5)
    """Greatest distance from the swath, in spacings."""

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if max(abs(candidate) for candidate in self.candidates_deg) > 80.0:
            raise ValueError(
                "candidates_deg must lie within 80 degrees of the swath, or the rover would not advance"
            )
        return self


class Attitude(NamedTuple):
    """Attitude of N rovers, the only information on the ground that steering gets.

    Yaw, pitch, roll are rotations about up, left and forward.

    `roll_rad` (N,): positive with the left side up. `pitch_rad` (N,): positive with the nose down.
    `heading_rad` (N,): counter-clockwise from east.

    >>> uphill = Attitude(np.zeros(1), np.array([-0.1]), np.zeros(1))
    >>> uphill.slope_along(np.array([0.0, np.pi])).round(2)
    array([ 0.1, -0.1])
    """

    roll_rad: FloatArray
    pitch_rad: FloatArray
    heading_rad: FloatArray

    def slope_along(self, heading_rad: FloatArray) -> FloatArray:
        """Return the slope of the plane that the rover stands on, along other headings.

        `heading_rad` (..., N): counter-clockwise from east. Returns (..., N): rise per metre.
        """
        ahead = -np.tan(self.pitch_rad)
        left = np.tan(self.roll_rad) / np.cos(self.pitch_rad)
        turn = heading_rad - self.heading_rad
        slope: FloatArray = ahead * np.cos(turn) + left * np.sin(turn)
        return slope


AttitudeSensor = Callable[[FloatArray, FloatArray], Attitude]
"""Attitude of N rovers at the places (N, 2) [m] and headings (N,) [rad]."""


def attitude_sensor(dems: Dem | Sequence[Dem], base_m: float = 1.0) -> AttitudeSensor:
    """Return the attitude of rovers at rest on terrain: for simulation, one rover per DEM.

    `base_m`: length and width of the rover [m].

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 10.0)
    >>> sense = attitude_sensor(Dem.on(grid, np.tile(0.1 * grid.x, (5, 1))))
    >>> float(sense(np.array([[20.0, 20.0]]), np.zeros(1)).pitch_rad[0].round(3))
    -0.1
    """
    several = [dems] if isinstance(dems, Dem) else list(dems)
    first = several[0]
    if any(d.shape != first.shape or not d.transform.almost_equals(first.transform) for d in several):
        raise InputError("the DEMs lie on different grids; put all on one.")
    z = np.concatenate([dem.elevation.ravel() for dem in several])
    n_rows, n_columns = first.shape
    start = n_rows * n_columns * np.arange(len(several))

    def heights(xy: FloatArray) -> FloatArray:
        """Interpolate bilinearly at the places (..., N, 2), beyond the outer cells as at them."""
        column = np.clip((xy[..., 0] - first.transform.c) / first.transform.a - 0.5, 0.0, n_columns - 1.0)
        row = np.clip((xy[..., 1] - first.transform.f) / first.transform.e - 0.5, 0.0, n_rows - 1.0)
        i = np.minimum(row.astype(np.int64), n_rows - 2)
        j = np.minimum(column.astype(np.int64), n_columns - 2)
        s, t, cell = column - j, row - i, start + n_columns * i + j
        upper = (1.0 - s) * z[cell] + s * z[cell + 1]
        lower = (1.0 - s) * z[cell + n_columns] + s * z[cell + n_columns + 1]
        interpolated: FloatArray = (1.0 - t) * upper + t * lower
        return interpolated

    def rises(xy: FloatArray, directions_rad: FloatArray) -> FloatArray:
        """Return the rise per metre (D, N) of the rover's base in several directions (D, N)."""
        half = 0.5 * base_m * np.stack([np.cos(directions_rad), np.sin(directions_rad)], axis=-1)
        front, back = heights(np.stack([xy + half, xy - half]))
        rise = (front - back) / base_m
        return np.where(np.isnan(rise), 0.0, rise)

    def sense(xy: FloatArray, heading_rad: FloatArray) -> Attitude:
        ahead, left = rises(xy, np.stack([heading_rad, heading_rad + 0.5 * np.pi]))
        pitch = -np.arctan(ahead)
        roll = np.arctan(left * np.cos(pitch))
        return Attitude(roll, pitch, heading_rad)

    return sense


class SteeringState(NamedTuple):
    """State of steering between two steps.

    `swath_heading_rad`: heading of the swath, counter-clockwise from east. `mode` (N,) int: rule or candidate
    in force for each rover.
    """

    swath_heading_rad: float
    mode: IntArray


class Steering(Protocol):
    """Protocol of steering: the next heading from the sensed attitude alone, without map or position.

    All arrays hold one value per rover, so that a thousand trials are steered together.
    The rover calls `begin` at each swath, and at every step `steer`, then `after_step`;
    ``draws`` (N,) are uniform on [0, 1) from its own generator.
    """

    @property
    def step_m(self) -> float:
        """Distance driven between two decisions [m]."""

    @property
    def band_share(self) -> float:
        """Greatest distance from the swath, in spacings."""

    def begin(self, swath_heading_rad: float, draws: FloatArray) -> SteeringState:
        """Return the state at the start of a swath.

        `draws` (N,): uniform on [0, 1), one per rover.
        """

    def steer(self, attitude: Attitude, state: SteeringState) -> FloatArray:
        """Return the next headings.

        Returns (N,): headings, counter-clockwise from east [rad].
        """

    def after_step(self, state: SteeringState, draws: FloatArray) -> SteeringState:
        """Return the state for the next step.

        `draws` (N,): uniform on [0, 1), one per rover; 1 changes nothing.
        """


@dataclass(frozen=True)
class ConfiguredSteering:
    """Base of steering whose step and band are those of a configuration."""

    config: SteeredConfig

    @property
    def step_m(self) -> float:
        """Distance driven between two decisions [m]."""
        return self.config.step_m

    @property
    def band_share(self) -> float:
        """Greatest distance from the swath, in spacings."""
        return self.config.band_share
