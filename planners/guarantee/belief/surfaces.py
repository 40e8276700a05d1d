"""Classes of surface: how rough the ground is below what a coarse prior resolves.

A prior shows nothing finer than two or three of its cells. Finer relief is extrapolated through covariances whose
smoothness is that of measured ground of the same class, and what samples cannot separate is added as micro-relief.

- Bare ice: drone profiles near station S5, Greenland, after a high-pass at 35 m have standard deviations of
  0.28 to 0.62 m and a free smoothness of 1.54 (van Tiggelen et al. 2021, The Cryosphere 15, 2601; see
  `survey.terrain.micro_relief`). Roughness of glacier ice depends on scale in the same way (Rees and Arnold 2006,
  Journal of Glaciology 52, 214).
- Moraine, bedrock: natural surfaces have profiles with spectra near k⁻² (Sayles and Thomas 1978, Nature 271, 431),
  and roughness exponents of 0.3 to 1 (Shepard et al. 2001, Journal of Geophysical Research 106, 32777), thus the two
  roughest families.
- Snow: wind smooths it; the smooth families, and a few centimetres of sastrugi.
- Unknown: hills, drumlins, a lake shore and an alpine bowl in airborne lidar, the development half of
  ``python -m benchmarks.promise_on_real_ground``: surveys of 3 to 24 swaths on 31 windows are predicted without bias
  by Matérn 3/2 and Whittle together, and the logarithm of actual over predicted error has a standard deviation of
  0.41; that of the landscapes' means is 0.26. A part of it lies between the two families and in what the cells leave
  open, which are counted by themselves.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

from survey.reconstruction.gp.covariance.families import SearchedFamily

Surface = Literal["bare-ice", "snow", "moraine", "bedrock", "unknown"]


class SurfaceClass(NamedTuple):
    """How rough a class of ground is below the resolution of a prior.

    Parameters
    ----------
    weights : mapping
        Weight of each family of covariance before the prior is looked at.
    micro_relief_m : float
        Standard deviation of relief so fine that every sample sees another piece of it [m].
    spread : float
        Scale of the logarithm of actual over predicted error on ground of this class (Student's distribution).
    """

    weights: Mapping[SearchedFamily, float]
    micro_relief_m: float
    spread: float


SURFACES: dict[Surface, SurfaceClass] = {
    "bare-ice": SurfaceClass({"matern-3/2": 0.7, "whittle": 0.3}, 0.3, 0.2),
    "snow": SurfaceClass({"squared-exponential": 0.4, "matern-5/2": 0.4, "matern-3/2": 0.2}, 0.03, 0.15),
    "moraine": SurfaceClass({"matern-3/2": 0.4, "whittle": 0.6}, 0.15, 0.25),
    "bedrock": SurfaceClass({"matern-3/2": 0.3, "whittle": 0.7}, 0.15, 0.25),
    "unknown": SurfaceClass({"matern-3/2": 0.6, "whittle": 0.4}, 0.08, 0.25),
}
"""Measured or published roughness of each class of surface."""

SURFACE_NAMES: tuple[Surface, ...] = get_args(Surface)
