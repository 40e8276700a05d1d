"""Faults of a simulated drive: component, failure, time interval, strength."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Self

from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt, model_validator

from sim.config.sensors import sensor_failures
from survey.core.config import Section, Share

FAILURES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "camera": {
            "whiteout": 235.0,
            "glare": 0.4,
            "dark": 0.04,
            "blur": 4.0,
            "frozen": 0.0,
            "dropped": 0.0,
            "lens-drop": 0.15,
        },
        **sensor_failures(),
        "tracks": {"stuck-left": 0.0, "stuck-right": 0.0, "slippery": 0.3, "stopped": 0.0},
        "rover": {"carried": 0.0},
        "start": {"kidnapped": 30.0},
        "calibration": {"focal-length": 0.005, "pitch": 0.5, "wheels": 0.03},
        "scenery": {"mountains-hidden": 0.0},
    }
)
"""Failures of every component, with their usual strengths.

Camera: grey level of a white-out, share of the image's width with glare, share of the light left
in the dark (above 1: overexposure), standard deviation of a blur [px], radius of a drop as a
share of the width. Tracks: share of speed left to a stuck track, friction left on slippery
ground; stopped tracks lose the rover, in every fidelity. Start: distance of a kidnapping [m]. Calibration: relative error of the focal length,
error of the camera's pitch [deg], relative error of the wheels. While the rover is carried all
instruments aboard are off. 0 where no strength is needed."""


class FaultConfig(Section):
    """A fault during an interval of time.

    Faults of start, calibration and scenery last for all of the drive.

    Examples
    --------
    >>> FaultConfig(component="gps", failure="jump", from_s=60.0, until_s=90.0).size
    15.0
    """

    component: str
    """Component that fails; a key of `FAILURES`."""
    failure: str
    """Its failure; one of those that `FAILURES` lists for the component."""
    from_s: NonNegativeFloat = 0.0
    """Begin [s]."""
    until_s: PositiveFloat | None = None
    """End [s]; the end of the drive when left out."""
    strength: NonNegativeFloat | None = None
    """Strength; see `FAILURES` for its meaning and usual value."""
    rover: PositiveInt | None = None
    """Rover of the fleet that it affects, counted from 1; all of them when left out."""
    probability: Share = 1.0
    """Probability that it affects a rover; drawn from the mission's seed."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.component not in FAILURES:
            raise ValueError(
                f"the component {self.component!r} is not known; give one of {', '.join(FAILURES)}"
            )
        known = FAILURES[self.component]
        if self.failure not in known:
            raise ValueError(f"{self.component} has the failures {', '.join(known)}, not {self.failure!r}")
        if self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError("a fault has to end after it begins")
        return self

    @property
    def size(self) -> float:
        """Strength as given, or the usual one."""
        return FAILURES[self.component][self.failure] if self.strength is None else self.strength

    def is_on(self, time_s: float) -> bool:
        """Return whether the fault acts at a time [s].

        Parameters
        ----------
        time_s : float
            Time since the start [s].

        Returns
        -------
        bool
            True between begin and end of the fault.
        """
        return self.from_s <= time_s and (self.until_s is None or time_s < self.until_s)


def faults_of(faults: Sequence[FaultConfig], component: str) -> list[FaultConfig]:
    """Return the faults of one component, in their order."""
    return [fault for fault in faults if fault.component == component]
