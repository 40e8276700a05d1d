"""Error of followed corners, measured by the residuals of resection."""

import numpy as np

from survey.core.arrays import FloatArray

_RAYLEIGH_MEDIAN = float(np.sqrt(2.0 * np.log(2.0)))  # of the length of two errors of unit variance
_MEMORY = 50  # images


class PixelNoise:
    r"""Running standard deviation of the pixel error of followed corners, per coordinate.

    The residuals of corners about the best pose have the length of two Gaussian errors, whose median
    is :math:`σ \sqrt{2 \ln 2}`. They hold what blur, noise and compression add to the error of tracking;
    the difference between tracking forward and backward does not: on a street it is a seventh of the residuals.
    Of a lens that nothing states they would hold its distortion, so that they are not measured then.
    The assumed error is the least, since residuals leave out what neighbouring corners have in common.

    Parameters
    ----------
    assumed_px : float
        Error of images of good quality [pixels].

    Examples
    --------
    >>> noise = PixelNoise(0.5)
    >>> for _ in range(200):
    ...     noise.update(np.full(9, 2.0))
    >>> round(noise.sigma_px, 2)
    1.68
    """

    def __init__(self, assumed_px: float) -> None:
        self._assumed_px = self._mean_px = assumed_px

    @property
    def sigma_px(self) -> float:
        """The measured error, or the assumed one where that is larger [pixels]."""
        return max(self._assumed_px, self._mean_px)

    def update(self, residual_px: FloatArray) -> None:
        """Add the residuals (N,) of one image [pixels]."""
        if len(residual_px):
            measured_px = float(np.median(residual_px)) / _RAYLEIGH_MEDIAN
            self._mean_px += (measured_px - self._mean_px) / _MEMORY
