"""Steering while driving: its state, its protocol, and its base class."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from planners.config_steered import SteeredConfig
from planners.steering.attitude import Attitude
from survey.core.arrays import FloatArray, IntArray


class SteeringState(NamedTuple):
    """State of steering between two steps.

    Parameters
    ----------
    swath_heading_rad : float
        Heading of the swath, counter-clockwise from east.
    mode : (N,) ndarray of int
        Rule or candidate in force for each rover.
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

        Parameters
        ----------
        swath_heading_rad : float
            Heading of the swath, counter-clockwise from east.
        draws : (N,) ndarray
            Uniform on [0, 1), one per rover.

        Returns
        -------
        SteeringState
            For N rovers.
        """

    def steer(self, attitude: Attitude, state: SteeringState) -> FloatArray:
        """Return the next headings.

        Parameters
        ----------
        attitude : Attitude
            Sensed attitude of N rovers.
        state : SteeringState
            As `begin` or `after_step` returned it.

        Returns
        -------
        (N,) ndarray
            Headings, counter-clockwise from east [rad].
        """

    def after_step(self, state: SteeringState, draws: FloatArray) -> SteeringState:
        """Return the state for the next step.

        Parameters
        ----------
        state : SteeringState
            The state during the step.
        draws : (N,) ndarray
            Uniform on [0, 1), one per rover; 1 changes nothing.

        Returns
        -------
        SteeringState
            The state for the next step.
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
