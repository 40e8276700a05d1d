"""Measured points of the terrain surface, each with its uncertainty: what maps are made of."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from pyproj import CRS

from survey.arrays import BoolArray, FloatArray, checked, frozen
from survey.errors import InputError
from survey.geodesy import UNSTATED, projected_crs


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the terrain with covariances.

    Parameters
    ----------
    xyz : (N, 3) array_like
        Easting, northing and elevation [m].
    covariance : (N, 3, 3) array_like, optional
        Of easting, northing and elevation [m²].
    sigma_m : float or (N,) array_like, optional
        Standard deviation of the elevation [m], for points whose place is exact. Give
        this or `covariance`.
    origins : (N, 3) array_like, optional
        Where the sensor stood [m].
    range_m : (N,) array_like, optional
        Distance from the sensor when the point was first seen [m].
    values : mapping of str to (N,) array_like
        Other quantities sampled at the points, units in the names: ``temperature_c`` …
    value_sigmas : mapping of str to (N,) array_like
        Standard deviation of each of them, in its unit.
    crs : str or pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        What elevations count from; ``""`` when unstated.

    Raises
    ------
    InputError
        Wrong shapes, NaN, no points, zero or negative variances, covariances that are
        not symmetric, both or neither of the two uncertainties.

    Examples
    --------
    >>> points = SurfacePoints([[0.0, 0.0, 5.0]], sigma_m=0.1, crs="EPSG:32608")
    >>> points.sigma_z
    array([0.1])
    """

    xyz: FloatArray
    covariance: FloatArray | None = None
    sigma_m: Any = None
    origins: FloatArray | None = None
    range_m: FloatArray | None = None
    values: Mapping[str, FloatArray] = field(default_factory=dict)
    value_sigmas: Mapping[str, FloatArray] = field(default_factory=dict)
    crs: CRS = None  # type: ignore[assignment]  # refused below with a sentence of its own
    vertical_datum: str = UNSTATED

    def __post_init__(self) -> None:
        xyz = checked(self.xyz, (None, 3), "the surface points")
        n = len(xyz)
        if n == 0:
            raise InputError("there are no surface points; at least one is needed.")
        object.__setattr__(self, "xyz", xyz)
        object.__setattr__(self, "crs", projected_crs(self.crs, "the set of surface points"))
        self._check_uncertainty(n)
        if self.origins is not None:
            object.__setattr__(self, "origins", checked(self.origins, (n, 3), "the origins of the sightings"))
        if self.range_m is not None:
            object.__setattr__(self, "range_m", checked(self.range_m, (n,), "the ranges at first sight"))
        for name in ("values", "value_sigmas"):
            columns = {
                key: checked(column, (n,), f"the values of {key}")
                for key, column in getattr(self, name).items()
            }
            object.__setattr__(self, name, MappingProxyType(columns))

    def _check_uncertainty(self, n: int) -> None:
        if (self.covariance is None) == (self.sigma_m is None):
            raise InputError("surface points need either a covariance or a sigma_m, and not both.")
        if self.covariance is not None:
            covariance = checked(self.covariance, (n, 3, 3), "the covariances of the surface points")
            variance_z = covariance[:, 2, 2]
            if not np.allclose(covariance, covariance.transpose(0, 2, 1), rtol=1e-9, atol=1e-12):
                raise InputError("some covariances of the surface points are not symmetric; correct them.")
            if (np.linalg.eigvalsh(covariance)[:, 0] < -1e-9 * np.trace(covariance, axis1=1, axis2=2)).any():
                raise InputError(
                    "some covariances of the surface points have negative variances; correct them."
                )
            object.__setattr__(self, "covariance", covariance)
        else:
            sigma = checked(
                np.broadcast_to(np.asarray(self.sigma_m, dtype=np.float64), (n,)), (n,), "the sigmas"
            )
            object.__setattr__(self, "sigma_m", sigma)
            variance_z = np.where(sigma > 0, sigma**2, 0.0)
        n_bad = int((variance_z <= 0.0).sum())
        if n_bad:
            raise InputError(
                f"{n_bad} surface points have an elevation variance of 0 or less; every measurement errs, state by how much."
            )

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def xy(self) -> FloatArray:
        """Easting and northing [m], (N, 2)."""
        return self.xyz[:, :2]

    @property
    def z(self) -> FloatArray:
        """Elevation [m], (N,)."""
        return self.xyz[:, 2]

    @property
    def sigma_z(self) -> FloatArray:
        """Marginal standard deviation of the elevation [m], (N,), as Eq. 7 has it."""
        if self.covariance is not None:
            return np.sqrt(self.covariance[:, 2, 2])
        sigma: FloatArray = self.sigma_m
        return sigma

    def select(self, mask: BoolArray) -> Self:
        """Return the points for which `mask` (N,) holds, or those at the given indices."""

        def pick(array: FloatArray | None) -> Any:
            return None if array is None else frozen(array[mask])

        return type(self)(
            frozen(self.xyz[mask]),
            pick(self.covariance),
            pick(self.sigma_m),
            pick(self.origins),
            pick(self.range_m),
            {name: frozen(column[mask]) for name, column in self.values.items()},
            {name: frozen(column[mask]) for name, column in self.value_sigmas.items()},
            self.crs,
            self.vertical_datum,
        )
