"""Geometry and stated errors of a spinning LiDAR."""

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from survey.core.arrays import FloatArray
from survey.core.config import Section


class Scanner(Section):
    """Geometry and stated errors of a spinning LiDAR, as its data sheet and its mounting give them.

    Examples
    --------
    >>> Scanner(elevation_deg=(0.0,), n_columns=4).rays()[1, 0].round(6).tolist()
    [0.0, 1.0, 0.0]
    """

    elevation_deg: tuple[float, ...] = Field(min_length=1, max_length=255)
    """Angles of the beams above the scanner's plane [deg]."""
    n_columns: int = Field(ge=1, le=65535)
    """Directions per turn."""
    turn_s: PositiveFloat = 0.1
    """Duration of a turn [s]."""
    mount_m: tuple[float, float, float] = (0.0, 0.0, 1.5)
    """Place of the scanner in the body's frame: forward, left, up [m]; its axes are those of the body."""
    range_sigma_m: PositiveFloat = 0.03
    """Standard deviation of a range [m]."""
    angle_sigma_deg: NonNegativeFloat = 0.05
    """Standard deviation of a beam's direction, with the divergence of the pulse [deg]."""

    @classmethod
    def hdl_64(cls) -> "Scanner":
        """Return the Velodyne HDL-64: 32 beams from 2° to -8.33° and 32 from -8.83° to -24.33°, 2083 columns.

        Returns
        -------
        Scanner
            With the default errors and mounting.
        """
        upper, lower = np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)
        return cls(elevation_deg=(*upper.tolist(), *lower.tolist()), n_columns=2083)

    def rays(self) -> FloatArray:
        """Return the directions of all beams; columns turn counter-clockwise from ahead.

        Returns
        -------
        (n_columns, n_beams, 3) ndarray
            Unit vectors in the body's frame.
        """
        azimuth = 2.0 * np.pi * np.arange(self.n_columns)[:, None] / self.n_columns
        up = np.radians(self.elevation_deg)[None]
        return np.stack(
            [np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up) + 0.0 * azimuth], axis=-1
        )
