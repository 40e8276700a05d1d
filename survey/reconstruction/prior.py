"""Error model of a prior elevation model: classes of elevation products, and the settings that choose and change them.

`ErrorScale` is the log-normal prior of a standard deviation. `PriorErrors` are the standard deviations of offset, tilt,
shift, and correlated and white errors of cells; `PRODUCTS` lists those of common products with the specification that each
follows. `SatelliteErrors` is the section of the settings. The module imports none of the reconstruction methods, which all
use it.
"""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field

from survey.core import FloatArray, Section

# Spread of the logarithm of an error's size within a class of products: a factor of 2.2 either way.
_CLASS_LOG_SD = 0.8
# Offsets differ more: a factor of 2.7 either way.
_LEVEL_LOG_SD = 1.0


class ErrorScale(NamedTuple):
    """Log-normal prior of a standard deviation.

    `median_m`: median [m]; 0 where the error is absent. `log_sd`: standard deviation of its natural
    logarithm; 0 where it is known exactly, infinite where nothing is known.

    >>> ErrorScale(1.0, 0.5).log_density(np.array([np.exp(0.5), np.exp(1.0)]))
    array([-0.5, -2. ])
    """

    median_m: float
    log_sd: float = _CLASS_LOG_SD

    @property
    def is_known(self) -> bool:
        """Whether the standard deviation is fixed."""
        return self.log_sd == 0.0

    def log_density(self, sigma_m: FloatArray) -> FloatArray:
        """Return the log density of ln σ, up to a constant.

        `sigma_m`: standard deviations [m], positive. Returns: as many log densities; 0 everywhere for a size
        that is known exactly or not at all.
        """
        if self.is_known or not np.isfinite(self.log_sd):
            return np.zeros_like(sigma_m)
        density: FloatArray = -0.5 * np.square(np.log(sigma_m / self.median_m) / self.log_sd)
        return density


class PriorErrors(NamedTuple):
    """Standard deviations of the errors of an elevation product on a survey site.

    `white`: error of a cell, independent of its neighbours'. `correlated`: error that neighbouring cells
    share. `correlation_m`: distance over which its correlation falls to 1/e [m]. `datum_sigma_m`: vertical
    offset of the product from the survey's datum [m]. `epoch_sigma_m`: vertical offset by melt, snow and
    radar penetration since the date of the product [m]. `tilt_sigma_m_per_km`: slope of the product's error,
    to the east and to the north [m/km]. `shift_sigma_m`: horizontal displacement of the product, to the east
    and to the north [m]. `source`: specification or study that the values follow. `level_log_sd`: standard
    deviation of the natural logarithm of both offsets' size; 0 where it is known exactly.
    """

    white: ErrorScale
    correlated: ErrorScale
    correlation_m: float
    datum_sigma_m: float
    epoch_sigma_m: float
    tilt_sigma_m_per_km: float
    shift_sigma_m: float
    source: str
    level_log_sd: float = _LEVEL_LOG_SD

    @property
    def level_sigma_m(self) -> float:
        """Standard deviation of the vertical offset in total [m]."""
        return float(np.hypot(self.datum_sigma_m, self.epoch_sigma_m))


# LE90 is 1.645 standard deviations of a height, CE90 2.146 of either horizontal axis. Epochs take glaciers to thin by
# half a metre a year (Hugonnet et al., Nature 592, 2021).
PRODUCTS: dict[str, PriorErrors] = {
    "copernicus-30": PriorErrors(
        ErrorScale(0.8), ErrorScale(1.2), 250.0, 2.4, 5.0, 0.5, 2.8,
        "Copernicus DEM Product Handbook (Airbus, 2020): absolute height 4 m LE90, relative height 2 m LE90 on slopes "
        "up to 20 %, absolute position 6 m CE90; acquired 2011 to 2015",
    ),
    "srtm-90": PriorErrors(
        ErrorScale(2.0), ErrorScale(3.0), 300.0, 4.0, 10.0, 1.0, 5.9,
        "Rodriguez et al. (Photogramm. Eng. Remote Sens. 72, 2006): absolute height 9.0 m LE90 and position 12.6 m CE90 "
        "in North America; February 2000, C-band penetrates metres of firn",
    ),
    "aster-30": PriorErrors(
        ErrorScale(4.0), ErrorScale(6.0), 500.0, 5.0, 6.0, 2.0, 6.0,
        "Tachikawa et al. (ASTER GDEM Version 2 summary of validation results, 2011): height 17 m at 95 %; scenes of "
        "2000 to 2013",
    ),
    "arcticdem-2": PriorErrors(
        ErrorScale(0.2), ErrorScale(0.4), 500.0, 2.4, 2.0, 0.5, 1.9,
        "Noh and Howat (GIScience Remote Sens. 52, 2015): 4 m in height and position without ground control, 0.2 m "
        "relative; scenes of 2008 to 2021",
    ),
    "unknown": PriorErrors(
        ErrorScale(1.0), ErrorScale(1.5), 250.0, 0.7, 0.7, 1.0, 5.0,
        "own choice, between the classes that are specified",
    ),
    "unbiased": PriorErrors(
        ErrorScale(1.0, np.inf), ErrorScale(0.0, 0.0), 250.0, 0.0, 0.0, 0.0, 0.0,
        "block means of the terrain itself with independent errors, as in the glacier paper", 0.0,
    ),
}  # fmt: skip
"""Error models by class of product; ``unbiased`` has independent errors alone, of a size that is not known."""


# A stated size of an error may be wrong by a factor of 1.65 either way; cells that say otherwise correct it.
_STATED_LOG_SD = 0.5


def _known(name: str) -> str:
    if name not in PRODUCTS:
        raise ValueError(f"a class of elevation products ({', '.join(PRODUCTS)}) was expected")
    return name


ProductName = Annotated[str, AfterValidator(_known)]
"""Class of an elevation product, checked against `PRODUCTS`."""


class SatelliteErrors(Section):
    """Errors of a prior elevation model whose cells are measurements of the terrain.

    What is left out follows from the class of the product. The errors themselves are estimated with the map; the sizes
    of the independent and of the correlated one are estimated too, from a log-normal prior about the value given here.
    With ``product = "unbiased"`` stated values are exact.

    Examples
    --------
    >>> SatelliteErrors(product="copernicus-30", datum_sigma_m=0.0).model().level_sigma_m
    5.0
    """

    product: ProductName = "unknown"
    """Class of the product: copernicus-30, srtm-90, aster-30, arcticdem-2, unknown, or unbiased (independent errors
    alone)."""
    sigma_m: float | None = Field(default=None, gt=0)
    """Error of a cell, independent of its neighbours' [m]."""
    correlated_sigma_m: float | None = Field(default=None, ge=0)
    """Error that neighbouring cells share [m]."""
    correlation_m: float | None = Field(default=None, gt=0)
    """Distance over which they share it [m]."""
    datum_sigma_m: float | None = Field(default=None, ge=0)
    """Vertical offset of all cells from the survey's datum [m]."""
    epoch_sigma_m: float | None = Field(default=None, ge=0)
    """Vertical offset by melt and snow since the date of the product [m]."""
    tilt_sigma_m_per_km: float | None = Field(default=None, ge=0)
    """Slope of the product's error on either axis [m/km]."""
    shift_sigma_m: float | None = Field(default=None, ge=0)
    """Horizontal displacement of the product on either axis [m]."""

    def model(self) -> PriorErrors:
        """Return the error model: stated values, and those of the product's class for the others.

        Returns
        -------
        PriorErrors
            Standard deviations and their priors.
        """
        known = PRODUCTS[self.product]
        log_sd = 0.0 if self.product == "unbiased" else _STATED_LOG_SD
        return PriorErrors(
            _scale(self.sigma_m, known.white, log_sd),
            _scale(self.correlated_sigma_m, known.correlated, log_sd),
            _stated(self.correlation_m, known.correlation_m),
            _stated(self.datum_sigma_m, known.datum_sigma_m),
            _stated(self.epoch_sigma_m, known.epoch_sigma_m),
            _stated(self.tilt_sigma_m_per_km, known.tilt_sigma_m_per_km),
            _stated(self.shift_sigma_m, known.shift_sigma_m),
            known.source,
            self._level_log_sd(known),
        )

    def _level_log_sd(self, known: PriorErrors) -> float:
        """Return the spread of the offsets' size: that of the class unless an offset is stated."""
        is_stated = self.datum_sigma_m is not None or self.epoch_sigma_m is not None
        return min(known.level_log_sd, _STATED_LOG_SD) if is_stated else known.level_log_sd


def _stated(value: float | None, default: float) -> float:
    return default if value is None else value


def _scale(value: float | None, default: ErrorScale, log_sd: float) -> ErrorScale:
    """Return the prior of a size; one that is stated as 0 is absent."""
    if value is None:
        return default
    return ErrorScale(value, log_sd if value > 0.0 else 0.0)
