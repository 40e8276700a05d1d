"""Families of covariance functions by name, and kernels as settings."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, InstanceOf, PlainSerializer

from survey.core.errors import ConfigError
from survey.reconstruction.gp.covariance.kernel_sum import Sum
from survey.reconstruction.gp.covariance.kernels import KINDS, Kernel, Matern32, SquaredExponential
from survey.reconstruction.gp.covariance.rational_quadratic import RationalQuadratic

_SCALES: dict[str, tuple[type[SquaredExponential | Matern32], ...]] = {
    "two-scale": (SquaredExponential, SquaredExponential),
    "two-scale-matern": (Matern32, Matern32),
    "two-scale-mixed": (SquaredExponential, Matern32),
    "three-scale": (SquaredExponential, SquaredExponential, SquaredExponential),
}
FAMILIES = ("auto", *KINDS, *_SCALES)
"""Names of the families; ``auto`` takes the likeliest."""
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

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    variance_m2, length_scale_m : float
        Variance [m²] and length scale [m], of the longest scale where there are several.
    anisotropy, angle_deg : float
        Ratio of the length scales along and across, and direction of the former [deg].
    shape : float
        Exponent of the rational quadratic.
    second : (float or None, float or None)
        Variance and length scale of the shortest scale; by default a third of the length and a tenth of the variance.
        A third scale lies half-way between the two, by ratios.

    Returns
    -------
    Kernel
        The covariance function.

    Examples
    --------
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

    Examples
    --------
    >>> family_of(Matern32(4.0, 25.0))
    'matern-3/2'
    """
    names: dict[type[Kernel], str] = {Sum: "sum"}
    names |= {kind: name for name, kind in KINDS.items()}
    return names.get(type(kernel), type(kernel).__name__)


def kernel_facts(kernel: Kernel) -> dict[str, Any]:
    """Return a kernel as numbers and texts, from which `kernel_from` makes it again.

    Raises
    ------
    ConfigError
        A kernel that is not registered.
    """
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

    Examples
    --------
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
