"""What can go wrong on a drive: component, failure, stretch of time, strength."""

from types import MappingProxyType
from typing import Literal, Self

from pydantic import NonNegativeFloat, PositiveFloat, model_validator

from survey.core.config import Section

Component = Literal["camera", "gps", "tracks", "rover", "start", "calibration", "scenery"]

FAILURES = MappingProxyType(
    {
        ("camera", "whiteout"): 235.0,
        ("camera", "glare"): 0.4,
        ("camera", "dark"): 0.04,
        ("camera", "blur"): 4.0,
        ("camera", "frozen"): 0.0,
        ("camera", "dropped"): 0.0,
        ("camera", "lens-drop"): 0.15,
        ("gps", "off"): 0.0,
        ("gps", "frozen"): 0.0,
        ("gps", "jump"): 15.0,
        ("gps", "delayed"): 2.0,
        ("tracks", "stuck-left"): 0.0,
        ("tracks", "stuck-right"): 0.0,
        ("tracks", "slippery"): 0.3,
        ("rover", "carried"): 0.0,
        ("start", "kidnapped"): 30.0,
        ("calibration", "focal-length"): 0.005,
        ("calibration", "pitch"): 0.5,
        ("calibration", "wheels"): 0.03,
        ("scenery", "mountains-hidden"): 0.0,
    }
)
"""Usual strengths: grey level of a white-out, share of the image's width that glares, share of
the light left in the dark, standard deviation of a blur [px], radius of a drop as a share of
the width, a jump and a kidnapping [m], a delay [s], the share of speed left to a stuck track and
of friction left on slippery ground, the relative error of the focal length, the camera's stated
angle below what it is [deg], what the wheels count too much; 0 where none is needed. A share of
light above 1 is an exposure that is too long. A rover that is carried has all its instruments off."""


class FaultConfig(Section):
    """Something that goes wrong during a stretch of time.

    Start, calibration and scenery are wrong for the whole drive.

    Examples
    --------
    >>> FaultConfig(component="gps", failure="jump", from_s=60.0, until_s=90.0).size
    15.0
    """

    component: Component
    """What fails."""
    failure: str
    """How it fails."""
    from_s: NonNegativeFloat = 0.0
    """Begin [s]."""
    until_s: PositiveFloat | None = None
    """End [s]; the end of the drive when left out."""
    strength: NonNegativeFloat | None = None
    """How bad; see `FAILURES` for what it means and its usual value."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        known = [failure for component, failure in FAILURES if component == self.component]
        if self.failure not in known:
            raise ValueError(f"{self.component} knows the failures {', '.join(known)}, not {self.failure!r}")
        if self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError("a fault has to end after it begins")
        return self

    @property
    def size(self) -> float:
        """The strength, or the usual one."""
        return FAILURES[self.component, self.failure] if self.strength is None else self.strength

    def is_on(self, time_s: float) -> bool:
        """Tell whether it is there at a time [s]."""
        return self.from_s <= time_s and (self.until_s is None or time_s < self.until_s)
