"""Mismatch of assumed and drawn errors: the estimator's assumptions differ from the simulated sensors by drawn ratios."""

from typing import Self

import numpy as np
from pydantic import PositiveFloat, model_validator

from survey.core.config import Section
from survey.core.streams import stream
from vision_slam import LocalizationConfig

_SIGMAS = (
    "yaw_sigma_deg",
    "tilt_sigma_deg",
    "scale_sigma",
    "step_sigma_m",
    "gps_bias_sigma_m",
    "gps_white_sigma_m",
    "barometer_drift_sigma_m",
    "barometer_white_sigma_m",
)
_CORRELATIONS = ("gps_correlation_time_s", "barometer_correlation_time_s", "attitude_correlation_m")


class MismatchConfig(Section):
    """Ranges of the ratios of assumed to drawn errors; each ratio is drawn from its range, uniform in the logarithm."""

    sigma_ratio: tuple[PositiveFloat, PositiveFloat] = (1.0, 1.0)
    """Least and greatest ratio of an assumed standard deviation to the one that ``localization`` states."""
    landmark_ratio: tuple[PositiveFloat, PositiveFloat] = (1.0, 1.0)
    """The same of the claimed to the drawn standard deviations of landmarks, statistical fidelity only."""
    correlation_ratio: tuple[PositiveFloat, PositiveFloat] = (1.0, 1.0)
    """The same for assumed correlation times and lengths."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for name in ("sigma_ratio", "landmark_ratio", "correlation_ratio"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(
                    f"{name} goes from {low:g} to {high:g}, not from the smaller ratio to the greater"
                )
        return self

    def drawn_landmark_ratio(self, seed: int) -> float:
        """Draw the ratio of claimed to drawn standard deviations of landmarks.

        Parameters
        ----------
        seed : int
            The mission's seed.

        Returns
        -------
        float
            Within `landmark_ratio`.
        """
        return _drawn(self.landmark_ratio, seed, "landmarks")

    def assumed(self, stated: LocalizationConfig, seed: int) -> LocalizationConfig:
        """Return the assumptions of the estimator, off by the drawn ratios.

        Parameters
        ----------
        stated : LocalizationConfig
            Assumptions that are multiplied.
        seed : int
            The mission's seed; every ratio has a random stream of its own.

        Returns
        -------
        LocalizationConfig
            Equal to `stated` where the ranges are 1 to 1.

        Examples
        --------
        >>> wrong = MismatchConfig(sigma_ratio=(2.0, 2.0)).assumed(LocalizationConfig(), 1)
        >>> wrong.gps_bias_sigma_m, wrong.gps_correlation_time_s
        (2.0, 120.0)
        """
        ranges = dict.fromkeys(_SIGMAS, self.sigma_ratio) | dict.fromkeys(
            _CORRELATIONS, self.correlation_ratio
        )
        changed = {
            name: getattr(stated, name) * _drawn(between, seed, name)
            for name, between in ranges.items()
            if between != (1.0, 1.0)
        }
        return stated.model_copy(update=changed)


def _drawn(between: tuple[float, float], seed: int, name: str) -> float:
    """Draw a ratio, uniform in its logarithm."""
    low, high = np.log(between)
    return float(np.exp(stream(seed, "mismatch", name).uniform(low, high)))
