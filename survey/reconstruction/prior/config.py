"""Settings of the error model of a prior elevation model."""

from typing import Annotated

from pydantic import AfterValidator, Field

from survey.core.config import Section
from survey.reconstruction.prior.products import PRODUCTS, ErrorScale, PriorErrors

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
