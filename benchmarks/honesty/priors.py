"""Kinds of priors: cells of the terrain with the errors of real products, and what an oracle is given of them."""

from dataclasses import dataclass

import numpy as np

from benchmarks.honesty.terrains import CELL_M, SIDE_M
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.reconstruction.prior import SatelliteErrors
from survey.terrain.satellite import ProductErrors, product_copy

_EXACT = {"epoch_sigma_m": 0.0, "tilt_sigma_m_per_km": 0.0}


@dataclass(frozen=True)
class PriorKind:
    """One kind of prior.

    ``offset_m``, ``shift_m`` and ``correlated_m`` are sizes of its errors, ``stated_factor`` is the ratio of the stated
    to the true white error, 0 where none is stated; odd seeds take its inverse, and the opposite offset. ``product`` is
    the class that the user states.
    """

    offset_m: float = 0.0
    shift_m: float = 0.0
    correlated_m: float = 0.0
    stated_factor: float = 0.0
    product: str = "unknown"

    @property
    def reference(self) -> str:
        """Name of the kind whose oracle this one is compared with: that with the same cells."""
        alike = PriorKind(self.offset_m, self.shift_m, self.correlated_m)
        return next(name for name, kind in KINDS.items() if kind == alike)

    @property
    def oracle(self) -> SatelliteErrors:
        """Error model from which the prior is drawn; stated sizes are exact."""
        return SatelliteErrors(
            product="unbiased",
            sigma_m=1.0,
            datum_sigma_m=self.offset_m,
            shift_sigma_m=self.shift_m / np.sqrt(2.0),
            correlated_sigma_m=self.correlated_m,
            correlation_m=250.0,
        )

    def assumed(self, seed: int) -> SatelliteErrors:
        """Return what an ordinary user states: a class, or a white error that is wrong by a factor."""
        if self.stated_factor == 0.0:
            return SatelliteErrors(product=self.product)
        return SatelliteErrors(sigma_m=self.stated_factor if seed % 2 == 0 else 1.0 / self.stated_factor)

    def errors(self, seed: int) -> ProductErrors:
        """Return the errors of the prior of a seed."""
        angle = stream(seed, "honesty", "shift").uniform(0.0, 2.0 * np.pi)
        return ProductErrors(
            offset_m=self.offset_m * (1.0 if seed % 2 == 0 else -1.0),
            shift_m=(self.shift_m * float(np.cos(angle)), self.shift_m * float(np.sin(angle))),
            correlated_sigma_m=self.correlated_m,
        )


KINDS = {
    "truthful": PriorKind(),
    "truthful, stated so": PriorKind(product="unbiased"),
    "datum 0.5 m": PriorKind(offset_m=0.5),
    "shift 7 m": PriorKind(shift_m=7.0),
    "correlated 3 m": PriorKind(correlated_m=3.0),
    "all together": PriorKind(offset_m=0.5, shift_m=7.0, correlated_m=3.0),
    "wrong stated sigma": PriorKind(stated_factor=3.0),
}
"""The kinds; white errors are 1 m in all of them."""
BAD = tuple(name for name in KINDS if not name.startswith("truthful"))


def prior(kind: str, terrain: Dem, name: str, seed: int) -> Dem:
    """Return the cells of a kind of prior over the site, of a terrain's kind and seed."""
    inner = terrain.window((-1.0, -1.0, SIDE_M + 1.0, SIDE_M + 1.0))
    copy = product_copy(
        inner,
        KINDS[kind].errors(seed),
        rng=stream(seed, "honesty", "satellite", name),
        cell_m=CELL_M,
        correlated_rng=stream(seed, "honesty", "correlated", name),
    )
    return Dem(copy.elevation, copy.transform, copy.crs)
