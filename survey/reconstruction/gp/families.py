"""Families of covariance functions by name: single kernels and sums of two or three scales, and kernels as settings.

`Sum` adds kernels; its parts keep their own parameters. `kernel_of` makes the kernel of a family, `family_of` names the
family of a kernel. `kernel_facts` and `kernel_from` write a kernel to settings and read it from them.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Self

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BeforeValidator, InstanceOf, PlainSerializer

from survey.core import ConfigError, FloatArray
from survey.reconstruction.gp.kernels import KINDS, Kernel, Matern32, RationalQuadratic, SquaredExponential


@dataclass(frozen=True, init=False)
class Sum(Kernel):
    """Sum of independent kernels, such as a long and a short scale; their spectra add.

    `parts`: at least one kernel.

    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> kernel = Sum(SquaredExponential(11.6, 39.9), SquaredExponential(0.18, 13.0))
    >>> kernel.variance_m2
    11.78
    >>> kernel.length_scales_m
    (13.0, 39.9)
    """

    parts: tuple[Kernel, ...]
    variance_m2: float

    def __init__(self, *parts: Kernel) -> None:
        if not parts:
            raise ConfigError("A Sum of no kernels was given; at least one kernel was expected.")
        object.__setattr__(self, "parts", tuple(parts))
        object.__setattr__(self, "variance_m2", float(sum(part.variance_m2 for part in parts)))

    @property
    def length_scales_m(self) -> tuple[float, float]:
        """Shortest and longest length scale in any direction [m]."""
        scales = [scale for part in self.parts for scale in part.length_scales_m]
        return min(scales), max(scales)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What each entry of `log_parameters` is."""
        return tuple(
            f"{name} {k}" for k, part in enumerate(self.parts, start=1) for name in part.parameter_names
        )

    @property
    def log_parameters(self) -> FloatArray:
        """Free parameters: logarithms, and an angle in radians."""
        return np.concatenate([part.log_parameters for part in self.parts])

    @property
    def variance_gradient(self) -> FloatArray:
        """Derivative (P,) of `variance_m2` with respect to `log_parameters`."""
        return np.concatenate([part.variance_gradient for part in self.parts])

    def with_log_parameters(self, log_parameters: npt.ArrayLike) -> Self:
        """Return the same family with other parameters."""
        theta = np.asarray(log_parameters, dtype=np.float64)
        sizes = [len(part.parameter_names) for part in self.parts]
        pieces = np.split(theta, np.cumsum(sizes)[:-1])
        changed = (part.with_log_parameters(piece) for part, piece in zip(self.parts, pieces, strict=True))
        return type(self)(*changed)

    def covariance_of_lag(self, lag_m: FloatArray) -> FloatArray:
        """Return the covariance [m²] at the lags (..., 2) [m]."""
        total: FloatArray = np.sum([part.covariance_of_lag(lag_m) for part in self.parts], axis=0)
        return total

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the covariance [m²] between the points (A, 2) and (B, 2), as (A, B)."""
        total = self.parts[0].covariance(xy_a, xy_b)
        for part in self.parts[1:]:
            total += part.covariance(xy_a, xy_b)
        return total

    def spectral_density(self, omega: FloatArray) -> FloatArray:
        """Return the spectral density [m⁴] at the angular frequencies (..., 2) [rad/m]."""
        total: FloatArray = np.sum([part.spectral_density(omega) for part in self.parts], axis=0)
        return total

    def log_spectral_gradient(self, omega: FloatArray) -> FloatArray:
        """Return the gradient (P, ...) of the log spectral density with respect to `log_parameters`."""
        densities = [part.spectral_density(omega) for part in self.parts]
        total = np.sum(densities, axis=0)
        # Where the whole spectrum has underflowed no part matters, and 0 / 0 must not appear.
        shares = [np.divide(d, total, out=np.zeros_like(d), where=total > 0) for d in densities]
        return np.concatenate(
            [
                share * part.log_spectral_gradient(omega)
                for share, part in zip(shares, self.parts, strict=True)
            ]
        )

    def decay_m(self, ratio: float) -> float:
        """Return the distance [m] beyond which every part is below `ratio` times the variance of the sum."""
        shares = [part.variance_m2 / self.variance_m2 for part in self.parts]
        reaches = [
            part.decay_m(ratio / share)
            for share, part in zip(shares, self.parts, strict=True)
            if share > ratio
        ]
        return max(reaches)


def parts_of(kernel: Kernel) -> tuple[Kernel, ...]:
    """Return the parts of a sum; every part's first parameter is the logarithm of its variance."""
    return kernel.parts if isinstance(kernel, Sum) else (kernel,)


_SCALES: dict[str, tuple[type[SquaredExponential | Matern32], ...]] = {
    "two-scale": (SquaredExponential, SquaredExponential),
    "two-scale-matern": (Matern32, Matern32),
    "two-scale-mixed": (SquaredExponential, Matern32),
    "three-scale": (SquaredExponential, SquaredExponential, SquaredExponential),
}
FAMILIES = ("auto", *KINDS, *_SCALES)
"""Names of the families; ``auto`` takes the likeliest, or an average of several."""
SEARCHABLE = tuple(name for name, kind in KINDS.items() if kind.error_growth is not None)
"""Families of one scale and no further parameter, the smoothest first."""


def _known(name: str) -> str:
    if name not in FAMILIES:
        raise ValueError(f"a family of covariance functions ({', '.join(FAMILIES)}) was expected")
    return name


def _searchable(name: str) -> str:
    if name not in SEARCHABLE:
        raise ValueError(f"a family of one scale ({', '.join(SEARCHABLE)}) was expected")
    return name


KernelFamily = Annotated[str, AfterValidator(_known)]
"""Name of a family, or ``auto``, checked against the registry."""
SearchedFamily = Annotated[str, AfterValidator(_searchable)]
"""Name of a family of one scale, checked against the registry."""


def kernel_of(
    family: str,
    variance_m2: float,
    length_scale_m: float,
    *,
    anisotropy: float = 1.0,
    angle_deg: float = 0.0,
    shape: float = 2.0,
    second: tuple[float | None, float | None] = (None, None),
) -> Kernel:
    """Return the covariance function of a family; ``auto`` gives the squared exponential.

    `variance_m2`, `length_scale_m`: variance [m²] and length scale [m], of the longest scale where there are
    several. `anisotropy`, `angle_deg`: ratio of the length scales along and across, and direction of the
    former [deg]. `second` (float or None, float or None): variance and length scale of the shortest scale; by
    default a third of the length and a tenth of the variance. A third scale lies half-way between the two, by
    ratios.

    >>> kernel_of("two-scale", 9.0, 30.0).length_scales_m
    (10.0, 30.0)
    """
    first = (variance_m2, length_scale_m, anisotropy, angle_deg)
    if family in _SCALES:
        return _of_scales(_SCALES[family], first, second)
    if family == RationalQuadratic.family:
        return RationalQuadratic(*first, shape=shape)
    return KINDS.get(family, SquaredExponential)(*first)


def _of_scales(
    kinds: tuple[type[SquaredExponential | Matern32], ...],
    first: tuple[float, float, float, float],
    second: tuple[float | None, float | None],
) -> Sum:
    variance_m2, length_scale_m, anisotropy, angle_deg = first
    variance, length = second[0] or 0.1 * variance_m2, second[1] or length_scale_m / 3.0
    parts = [first, (variance, length, anisotropy, angle_deg)]
    if len(kinds) == 3:
        between = (np.sqrt(variance * variance_m2), np.sqrt(length * length_scale_m))
        parts.insert(1, (float(between[0]), float(between[1]), anisotropy, angle_deg))
    return Sum(*(kind(*part) for kind, part in zip(kinds, parts, strict=True)))


def family_of(kernel: Kernel) -> str:
    """Return the name of a kernel's family; ``sum`` for a sum, the class's name for one that is not registered.

    >>> family_of(Matern32(4.0, 25.0))
    'matern-3/2'
    """
    names: dict[type[Kernel], str] = {Sum: "sum"}
    names |= {kind: name for name, kind in KINDS.items()}
    return names.get(type(kernel), type(kernel).__name__)


def kernel_facts(kernel: Kernel) -> dict[str, Any]:
    """Return a kernel as numbers and texts, from which `kernel_from` makes it again."""
    if isinstance(kernel, Sum):
        return {"family": "sum", "parts": [kernel_facts(part) for part in kernel.parts]}
    if type(kernel) not in KINDS.values():
        raise ConfigError(
            f"a {type(kernel).__name__} is not among the families {', '.join(KINDS)} and cannot be written; add it to "
            "KINDS."
        )
    return {"family": family_of(kernel), **asdict(kernel)}  # type: ignore[call-overload]  # kernels are dataclasses


def kernel_from(facts: Mapping[str, Any]) -> Kernel:
    """Return the kernel that `kernel_facts` described.

    >>> kernel_from({"family": "whittle", "variance_m2": 4.0, "length_scale_m": 25.0})
    Whittle(variance_m2=4.0, length_scale_m=25.0, anisotropy=1.0, angle_deg=0.0)
    """
    given = dict(facts)
    family = given.pop("family", None)
    if family == "sum":
        return Sum(*(kernel_from(part) for part in given.get("parts", ())))
    if family not in KINDS:
        raise ConfigError(f"the kernel's family is {family!r}; one of sum, {', '.join(KINDS)} was expected.")
    try:
        return KINDS[family](**given)
    except TypeError as error:
        raise ConfigError(
            f"the kernel {family} has unknown or missing settings ({error}); give variance_m2 and length_scale_m."
        ) from error


def _parsed(given: Any) -> Any:
    if not isinstance(given, Mapping):
        return given
    try:
        return kernel_from(given)
    except ConfigError as error:
        raise ValueError(str(error).rstrip(".")) from error


KernelSetting = Annotated[
    InstanceOf[Kernel], BeforeValidator(_parsed), PlainSerializer(kernel_facts, return_type=dict)
]
"""A kernel as a setting: an object, or a table with its family and parameters."""
