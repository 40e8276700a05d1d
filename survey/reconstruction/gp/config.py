"""Settings of the Gaussian-process reconstruction."""

from typing import Literal, Self

from pydantic import Field, model_validator

from survey.core import Section
from survey.data.landmarks import SHARED_SIGMA_M
from survey.reconstruction.gp.families import KernelFamily, KernelSetting, kernel_of
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.prior import SatelliteErrors


class JointConfig(Section):
    """How map and path are estimated together."""

    satellite: SatelliteErrors = SatelliteErrors()
    """Errors of the prior's cells."""
    bow_sigma_deg: float = Field(default=0.0, ge=0)
    """By how much all landmarks of a drive may rise or sink alike, with their distance ahead and aside [deg]."""
    far_bias_sigma_m: float = Field(default=0.1, ge=0)
    """Prior standard deviation of the height by which landmarks from beyond 15 m lie too high, as crests do that hide
    troughs [m]; the bias is estimated with the map."""
    landmark_shared_sigma_m: float = Field(default=SHARED_SIGMA_M, ge=0)
    """Error of height that all landmarks of five metres of travel share [m]."""
    rank: int | None = Field(default=None, ge=1)
    """Number of modes of the path's error that are retained, as on large maps; all when left out."""
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
    >>> GaussianProcessConfig(fit=False, variance_m2=10.0, length_scale_m=17.75).stated_kernel().length_scale_m
    17.75
    """

    fit: bool = True
    """Whether to find the hyperparameters by their likelihood."""
    kernel: KernelSetting | None = None
    """Covariance function instead of `family` and its parameters; the place where a fit starts."""
    family: KernelFamily = "auto"
    """Covariance function; ``auto`` averages several, but in a joint map the likeliest are compared, and what is not fitted
    is the squared exponential; two scales are the sum of two squared exponentials, of two Matérn 3/2 or of one of each, the
    smooth one first; three that of three squared exponentials."""
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
    prior_level: Literal["exact", "estimated"] = "exact"
    """Whether a prior's level is exact, or an offset of the map from it is estimated."""
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
        if self.kernel is None and not self.fit and None in (self.variance_m2, self.length_scale_m):
            raise ValueError("fit = false needs variance_m2 and length_scale_m, or a kernel")
        if self.fit and self.prior_sigma_m is not None:
            raise ValueError("prior_sigma_m is found from the points when fit = true; leave it out")
        second = (self.second_variance_m2, self.second_length_scale_m)
        if not self.fit and "-scale" in self.family and None in second:
            raise ValueError(
                "fit = false with several scales needs second_variance_m2 and second_length_scale_m"
            )
        return self

    def trend(self, *, has_prior: bool) -> Literal["none", "constant", "plane"]:
        """Return what is estimated beside the process: the mean, or the offset from a prior's level.

        Parameters
        ----------
        has_prior : bool
            Whether the map is built around a prior.

        Returns
        -------
        {"none", "constant", "plane"}
            The trend.
        """
        if not has_prior:
            return self.mean
        return "constant" if self.prior_level == "estimated" else "none"

    @property
    def stated_length_m(self) -> float | None:
        """Shortest length scale that the settings state [m]; None where all are left out."""
        if self.kernel is not None:
            return self.kernel.length_scales_m[0]
        second_m = self.second_length_scale_m if "-scale" in self.family else None
        stated = [length for length in (self.length_scale_m, second_m) if length is not None]
        return min(stated) / max(self.anisotropy, 1.0) if stated else None

    def stated_kernel(self) -> Kernel:
        """Return the covariance function that the settings state.

        Returns
        -------
        Kernel
            `kernel`, or that of `family` and its parameters; 1 where a parameter is left out.
        """
        if self.kernel is not None:
            return self.kernel
        return kernel_of(
            self.family,
            self.variance_m2 or 1.0,
            self.length_scale_m or 1.0,
            anisotropy=self.anisotropy,
            angle_deg=self.angle_deg,
            shape=self.shape,
            second=(self.second_variance_m2, self.second_length_scale_m),
        )
