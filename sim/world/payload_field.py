"""Simulated field of a payload's quantity over the site: elevation, aspect, and variation from place to place."""

import numpy as np

from sim.config.payload import PayloadConfig
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.dem import Dem

# With a tenth of these waves the short ones are too few: the relief between swaths is then smoother or rougher than its
# covariance function says, from site to site.
_N_WAVES, _AT_ONCE = 4000, 50
_HALF_M = 5.0
_DEGREES = {"rough": 3.0, "medium": 5.0, "smooth": np.inf}


class PayloadField:
    """Field of one quantity: a sum of waves with random directions, about a linear dependence on elevation and aspect.

    Parameters
    ----------
    config : PayloadConfig
        Sizes of its parts.
    terrain : Dem
        Real terrain.
    seed : int
        Seed of the site: all rovers measure the same field.
    """

    def __init__(self, config: PayloadConfig, terrain: Dem, seed: int) -> None:
        self._config, self._terrain = config, terrain
        self._datum_m = float(np.nanmean(terrain.elevation))
        rng = stream(seed, "payload", config.name, "field")
        wave = rng.standard_normal((_N_WAVES, 2)) / config.field_length_m
        degrees = _DEGREES[config.field_kind]
        # Frequencies of a Matérn field follow Student's t-distribution.
        spread = np.ones(_N_WAVES) if np.isinf(degrees) else rng.chisquare(degrees, _N_WAVES) / degrees
        self._wave, self._phase = wave / np.sqrt(spread)[:, None], rng.uniform(0.0, 2.0 * np.pi, _N_WAVES)

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the values (N,) at places (N, 2); NaN where the terrain is not known."""
        config, middle = self._config, np.mean(self._terrain.bounds[:2])
        varied = np.zeros(len(xy))
        for first in range(0, _N_WAVES, _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            varied += np.cos((xy - middle) @ self._wave[part].T + self._phase[part]).sum(axis=1)
        varied *= config.field_sd * np.sqrt(2.0 / _N_WAVES)
        climbed_km = 1e-3 * (self._terrain.at(xy) - self._datum_m)
        values: FloatArray = config.mean + config.per_km_of_elevation * climbed_km + varied
        return values if config.facing_south == 0.0 else values + config.facing_south * self._southward(xy)

    def _southward(self, xy: FloatArray) -> FloatArray:
        """Return the southward part (N,) of the unit normals of the ground, over 10 m."""
        step = np.array([[_HALF_M, 0.0], [0.0, _HALF_M]])
        east, north = ((self._terrain.at(xy + d) - self._terrain.at(xy - d)) / (2.0 * _HALF_M) for d in step)
        southward: FloatArray = np.nan_to_num(north / np.sqrt(1.0 + east**2 + north**2))
        return southward
