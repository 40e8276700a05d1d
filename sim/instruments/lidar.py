"""Directions of the beams of a spinning LiDAR."""

from dataclasses import dataclass

import numpy as np

from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class Scanner:
    """Directions of the beams of a spinning LiDAR.

    Parameters
    ----------
    elevation_deg : tuple of float
        Angles of the beams above the scanner's plane [deg].
    n_columns : int
        Directions per turn.
    """

    elevation_deg: tuple[float, ...]
    n_columns: int

    @classmethod
    def hdl_64(cls) -> "Scanner":
        """Return the Velodyne HDL-64: 32 beams from 2° to -8.33° and 32 from -8.83° to -24.33°, 2083 columns."""
        upper, lower = np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)
        return cls((*upper.tolist(), *lower.tolist()), 2083)

    def rays(self) -> FloatArray:
        """Return the unit directions (n_columns, n_beams, 3) in the body's frame; columns turn counter-clockwise."""
        azimuth = 2.0 * np.pi * np.arange(self.n_columns)[:, None] / self.n_columns
        up = np.radians(self.elevation_deg)[None]
        return np.stack(
            [np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up) + 0.0 * azimuth], axis=-1
        )
