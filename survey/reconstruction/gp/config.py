"""Settings of the Gaussian-process reconstruction."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from survey.core.config import Section
from survey.reconstruction.gp.covariance.kernels import (
    Kernel,
    Matern32,
    Matern52,
    RationalQuadratic,
    SquaredExponential,
    Sum,
)

KernelFamily = Literal[
    "auto",
    "squared-exponential",
    "matern-3/2",
    "matern-5/2",
    "rational-quadratic",
    "two-scale",
    "two-scale-matern",
    "two-scale-mixed",
    "three-scale",
]


class SatelliteErrors(Section):
    """What is stated of a satellite's elevation model when its cells count as measurements."""

    sigma_m: float | None = Field(default=None, gt=0)
    """Error of a cell, independent of its neighbours' [m]; the likeliest, given the landmarks, when left out."""
    correlated_sigma_m: float = Field(default=0.0, ge=0)
    """Error that neighbouring cells share [m]."""
    correlation_m: float = Field(default=200.0, gt=0)
    """Distance over which they share it [m]."""
    datum_sigma_m: float = Field(default=0.0, ge=0)
    """What all cells may be too high or too low by, against the survey's datum [m]."""


class JointConfig(Section):
    """How map and path are estimated together."""

    satellite: SatelliteErrors = SatelliteErrors()
    """Errors of the prior's cells."""
    bow_sigma_deg: float = Field(default=0.0, ge=0)
    """By how much all landmarks of a drive may rise or sink alike, with their distance ahead and aside [deg]."""
    rank: int | None = Field(default=None, ge=1)
    """Number of modes of the path's error that are kept, as on large maps; all when left out."""
    slope_passes: int = Field(default=2, ge=1, le=5)
    """How often the map is solved for: slopes, through which places err, are those of the pass before."""
    memory_mb: float = Field(default=50.0, gt=0)
    """Memory that the covariance may take [MB]; waves beyond it count as noise of no extent."""


class GaussianProcessConfig(Section):
    """How a Gaussian process maps the points; the defaults fit everything to the points.

    With ``fit=False`` the hyperparameters given here are taken as they are, as in the
    glacier paper: ``GaussianProcessConfig(fit=False, variance_m2=10.0, length_scale_m=17.75)``.
    Squares and metres mean the mapped quantity's unit when it is not an elevation.

    Examples
    --------
    >>> GaussianProcessConfig(fit=False, variance_m2=10.0, length_scale_m=17.75).kernel().length_scale_m
    17.75
    """

    fit: bool = True
    """Whether to find the hyperparameters by their likelihood."""
    family: KernelFamily = "auto"
    """Covariance function; ``auto`` takes the likeliest (the squared exponential when not fitted); two scales
    are the sum of two squared exponentials, of two Matérn 3/2 or of one of each, the smooth one first; three that of three
    squared exponentials."""
    variance_m2: float | None = Field(default=None, gt=0)
    """Prior variance of the surface about its mean [m²]; the place where a fit starts."""
    length_scale_m: float | None = Field(default=None, gt=0)
    """Distance over which heights are alike [m]; the place where a fit starts."""
    anisotropy: float = Field(default=1.0, gt=0)
    """Length scale along `angle_deg` over length scale across; 1 is isotropic."""
    angle_deg: float = 0.0
    """Direction of the length scale, counter-clockwise from east [deg]."""
    shape: float = Field(default=2.0, gt=1)
    """Exponent of the rational quadratic."""
    second_variance_m2: float | None = Field(default=None, gt=0)
    """Prior variance of the short scale of ``two-scale`` [m²]."""
    second_length_scale_m: float | None = Field(default=None, gt=0)
    """Short length scale of ``two-scale`` [m]."""
    nugget_m: float | None = Field(default=None, ge=0)
    """Standard deviation of relief too fine to be mapped [m]; fitted when left out, 0 when nothing is fitted."""
    mean: Literal["constant", "plane"] = "constant"
    """The mean where no prior is given, by generalised least squares."""
    prior_interpolation: Literal["bilinear", "delaunay"] = "bilinear"
    """How a satellite prior is read between its cell centres."""
    prior_sigma_m: float | None = Field(default=None, ge=0)
    """Standard deviation of a prior's cell [m], 0 when left out; a fit finds it from the points and takes none."""
    horizontal_errors: Literal["slope", "marginal"] = "slope"
    """What becomes of x-y uncertainty: carried through the slope, or dropped as in Eq. 7."""
    robust: bool = False
    """Whether points far from their neighbours' prediction count less."""
    calibrate: bool | None = None
    """Whether blocked cross-validation scales the standard deviation; as `fit` when left out."""
    tolerance_m: float = Field(default=1e-3, gt=0)
    """Error of the mean that the fast engine may add [m]."""
    memory_mb: float = Field(default=300.0, gt=0)
    """Memory that the factorization may take [MB]; beyond it tiles are used."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if not self.fit and (self.variance_m2 is None or self.length_scale_m is None):
            raise ValueError("fit = false needs variance_m2 and length_scale_m")
        if self.fit and self.prior_sigma_m is not None:
            raise ValueError("prior_sigma_m is found from the points when fit = true; leave it out")
        second = (self.second_variance_m2, self.second_length_scale_m)
        if not self.fit and "-scale" in self.family and None in second:
            raise ValueError(
                "fit = false with several scales needs second_variance_m2 and second_length_scale_m"
            )
        return self

    def kernel(self) -> Kernel:
        """Return the covariance function of the hyperparameters given here."""
        return kernel_of(
            self.family,
            self.variance_m2 or 1.0,
            self.length_scale_m or 1.0,
            anisotropy=self.anisotropy,
            angle_deg=self.angle_deg,
            shape=self.shape,
            second=(self.second_variance_m2, self.second_length_scale_m),
        )


def kernel_of(
    family: KernelFamily,
    variance_m2: float,
    length_scale_m: float,
    *,
    anisotropy: float = 1.0,
    angle_deg: float = 0.0,
    shape: float = 2.0,
    second: tuple[float | None, float | None] = (None, None),
) -> Kernel:
    """Return the covariance function of a family.

    A missing second scale is a third of the first, a tenth as strong; a third scale lies half-way
    between the two, by ratios.
    """
    first = (variance_m2, length_scale_m, anisotropy, angle_deg)
    if family == "matern-3/2":
        return Matern32(*first)
    if family == "matern-5/2":
        return Matern52(*first)
    if family == "rational-quadratic":
        return RationalQuadratic(*first, shape=shape)
    if "-scale" in family:
        kind = Matern32 if family == "two-scale-matern" else SquaredExponential
        finer = SquaredExponential if family in ("two-scale", "three-scale") else Matern32
        variance, length = second[0] or 0.1 * variance_m2, second[1] or length_scale_m / 3.0
        parts = [first, (variance, length, anisotropy, angle_deg)]
        if family == "three-scale":
            between = (np.sqrt(variance * variance_m2), np.sqrt(length * length_scale_m))
            parts.insert(1, (float(between[0]), float(between[1]), anisotropy, angle_deg))
        return Sum(*(kind(*part) for part in parts[:-1]), finer(*parts[-1]))
    return SquaredExponential(*first)
