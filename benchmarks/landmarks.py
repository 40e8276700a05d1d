"""The world of the reconstruction benchmarks: a 600 m site of known relief, and landmarks seen from six swaths."""

from dataclasses import dataclass

import finufft
import numpy as np

from survey.core.arrays import FloatArray
from survey.core.streams import stream

SIZE_M = 600.0
RELIEF_M = 25.0
BOX_M = 1500.0
# Amplitude [m] and length scale [m] of the fields that the terrain is made of, before its relief is scaled.
FIELDS = ((5.0, 80.0), (2.0, 30.0), (1.2, 17.75), (0.4, 9.0))
SLOPE = 0.02
N_LEGS = 6
LEG_SPACING_M = 100.0
FARTHEST_M = 45.0
THINNED_BEYOND_M = 5.0


@dataclass(frozen=True)
class Site:
    """A terrain of exactly 25 m relief on the 601 x 601 nodes of the site."""

    coefficients: tuple[np.ndarray, ...]
    scale: float

    @classmethod
    def drawn(cls, seed: int) -> "Site":
        """Draw one terrain."""
        rng = stream(seed, "benchmark", "terrain")
        raw = cls(tuple(_spectrum(rng, *field) for field in FIELDS), 1.0)
        axis = np.linspace(0.0, SIZE_M, 601)
        nodes = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        return cls(raw.coefficients, RELIEF_M / float(np.ptp(raw.height_m(nodes))))

    def height_m(self, xy: FloatArray) -> FloatArray:
        """Height (N,) [m] at places (N, 2) [m]."""
        x, y = (np.ascontiguousarray(xy[:, k] * 2 * np.pi / BOX_M) for k in (0, 1))
        height = SLOPE * xy[:, 0]
        for coefficients in self.coefficients:
            height = height + finufft.nufft2d2(x, y, coefficients, eps=1e-9, isign=1, nthreads=1).real
        return self.scale * height


def _spectrum(rng: np.random.Generator, amplitude_m: float, length_scale_m: float) -> np.ndarray:
    """Random coefficients of a squared-exponential field."""
    half = int(6 / length_scale_m * BOX_M / (2 * np.pi)) + 2
    k = np.arange(-half, half + 1) * 2 * np.pi / BOX_M
    density = (
        2 * np.pi * length_scale_m**2 / BOX_M**2 * np.exp(-0.5 * length_scale_m**2 * (k[:, None] ** 2 + k**2))
    )
    draws = rng.standard_normal(density.shape) + 1j * rng.standard_normal(density.shape)
    return amplitude_m * draws * np.sqrt(density)


def landmarks(site: Site, n: int, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places (n, 2), heights (n,) and standard deviations (n,) [m] of landmarks beside six swaths 100 m apart.

    The standard deviation grows with the range at first sight from 0.05 m to 0.5 m.  Up to 5,000 landmarks are
    thinned to those first seen from beyond 5 m, as in the glacier paper.
    """
    rng = stream(seed, "benchmark", "landmarks", n)
    n_drawn = 4 * n + 1000
    leg, along = rng.integers(0, N_LEGS, n_drawn), rng.uniform(0, SIZE_M, n_drawn)
    range_m = 0.8 + rng.gamma(1.5, 6.0, n_drawn)
    bearing = rng.uniform(-1.2, 1.2, n_drawn) + np.pi * rng.integers(0, 2, n_drawn)
    first_leg = 0.5 * (SIZE_M - (N_LEGS - 1) * LEG_SPACING_M)
    x = first_leg + LEG_SPACING_M * leg + range_m * np.cos(bearing)
    xy = np.stack([x, along + range_m * np.sin(bearing)], axis=-1)
    nearest = THINNED_BEYOND_M if n <= 5000 else 0.0
    kept = ((xy >= 0) & (xy <= SIZE_M)).all(axis=1) & (range_m > nearest) & (range_m < FARTHEST_M)
    chosen = np.flatnonzero(kept)[:n]
    xy, sigma = xy[chosen], np.minimum(0.05 + 0.01 * range_m[chosen], 0.5)
    return xy, site.height_m(xy) + sigma * rng.standard_normal(len(xy)), sigma
