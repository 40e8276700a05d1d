"""The hummocks of bare glacier ice: relief too small for any satellite, with measured statistics.

The numbers come from four 200 m profiles of drone photogrammetry, 1 m apart, that leave the
weather station S5 on the Greenland ice sheet in the directions 90°, 120°, 150° and 186°
(6 September 2019; van Tiggelen et al., 2021, The Cryosphere 15, 2601, data under the MIT
licence in github.com/mvantiggelen/TC_2020). After the published high-pass at 35 m:

=============================  =====  =====  =====  =====
direction (from north) [deg]     90    120    150    186
standard deviation [m]         0.276  0.603  0.616  0.450
sd of the slope over 1 m       0.114  0.200  0.239  0.172
skewness                       -0.33   0.03  -0.21  -0.22
first zero of the correlation    5 m    6 m    6 m    5 m
=============================  =====  =====  =====  =====

An anisotropic Matérn field of smoothness 3/2 was fitted to their spectra between 4 m and 29 m by
Whittle's likelihood (`python -m benchmarks.ice_micro_relief` repeats it). A free smoothness comes out
at 1.54; without anisotropy the log-likelihood is 18 lower. The skewness is not different from 0.
"""

import numpy as np
from scipy.integrate import quad

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import Matern32
from survey.terrain.random_fields import require_resolved, spectral_field

LONGEST_WAVE_M = 35.0
"""Where the published profiles were high-passed [m]."""
ALONG_CRESTS_M = 18.5
"""Length scale along the crests of the hummocks [m]."""
ACROSS_CRESTS_M = 7.78
"""Length scale across the crests [m]."""
CREST_AZIMUTH_DEG = 65.0
"""Direction of the crests, clockwise from north [deg]."""
_UNFILTERED_SD_M = 1.192
"""Of the fitted field with all of its long waves, of which the filtered profiles say nothing [m]."""


def _share_of_short_waves() -> float:
    """Return the share of the fitted field's variance in waves shorter than the longest (any direction)."""
    cut = 2.0 * np.pi / LONGEST_WAVE_M
    area = ALONG_CRESTS_M * ACROSS_CRESTS_M

    def beyond(angle: float) -> float:
        squared = (ALONG_CRESTS_M * np.cos(angle)) ** 2 + (ACROSS_CRESTS_M * np.sin(angle)) ** 2
        return float(area / squared * (1.0 + cut**2 * squared / 3.0) ** -1.5)

    return float(quad(beyond, 0.0, 2.0 * np.pi)[0] / (2.0 * np.pi))


_SHARE = _share_of_short_waves()
MEASURED_SD_M = round(_UNFILTERED_SD_M * _SHARE**0.5, 2)
"""Standard deviation of the fitted field's waves shorter than 35 m [m]."""


def ice_micro_relief(
    grid: Grid,
    rng: np.random.Generator,
    *,
    sd_m: float = MEASURED_SD_M,
    crest_azimuth_deg: float = CREST_AZIMUTH_DEG,
) -> FloatArray:
    r"""Draw the micro-relief of bare ice, to be added to a smooth surface.

    A Gaussian field with the spectrum of an anisotropic Matérn 3/2 covariance (length
    scales 18.5 m along and 7.8 m across the crests), without waves longer than 35 m.
    A straight profile through it, high-passed at 35 m, has the spectrum of one through
    the whole Matérn field: a wave that is shorter than 35 m along a line is so on the ground.

    Parameters
    ----------
    grid : Grid
        Where the heights are wanted; steps of 5 m or less.
    rng : numpy.random.Generator
        Source of the draws.
    sd_m : float
        Standard deviation of the heights over many draws [m]. Straight profiles after the
        35 m high-pass show less of it: at the default 0.3 m near the crests' direction and
        0.55 m across, as measured, for waves that meet the line at an angle look longer.
    crest_azimuth_deg : float
        Direction of the crests, clockwise from north [deg].

    Returns
    -------
    (H, W) ndarray
        Height above the smooth surface [m], mean 0 over many draws, not of each.

    Raises
    ------
    InputError
        A standard deviation that is negative or not finite, or a grid too coarse for the waves.

    Notes
    -----
    One place at the end of one melt season stands behind the numbers. The relief between 35 m
    and a satellite's cell, crevasses and melt channels are not in them.

    Examples
    --------
    >>> grid = Grid((0.0, 0.0, 200.0, 200.0), 1.0)
    >>> ice_micro_relief(grid, np.random.default_rng(1), sd_m=0.5).shape
    (201, 201)
    """
    if not (np.isfinite(sd_m) and sd_m >= 0.0):
        raise InputError(f"the micro-relief's standard deviation is {sd_m} m; it must be 0 or greater.")
    kernel = Matern32(
        1.0 / _SHARE, ALONG_CRESTS_M, ALONG_CRESTS_M / ACROSS_CRESTS_M, 90.0 - crest_azimuth_deg
    )
    cut = 2.0 * np.pi / LONGEST_WAVE_M

    def short_waves(omega: FloatArray) -> FloatArray:
        return np.where((omega**2).sum(axis=-1) >= cut**2, kernel.spectral_density(omega), 0.0)

    heights, variance = spectral_field(grid, rng, short_waves, padding_m=4.0 * LONGEST_WAVE_M)
    require_resolved(grid, variance, ACROSS_CRESTS_M)
    return sd_m * heights
