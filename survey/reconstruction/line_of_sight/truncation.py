r"""A map with Gaussian errors, cut off at its lines of sight.

Where a map states the height N(m, s²) and lines of sight allow no more than c, the height is normal given
that it is below c. With a = (c - m) / s, the density φ and the distribution Φ of the standard normal,

.. math::  E = m - s \frac{\varphi(a)}{\Phi(a)}, \qquad
           V = s^2 \Big(1 - a \frac{\varphi(a)}{\Phi(a)} - \frac{\varphi(a)^2}{\Phi(a)^2}\Big)

and the bounds are the quantiles at which Φ has 2.5 and 97.5 % of Φ(a). Every node is cut by itself:
its neighbours do not follow, so that this suits maps whose ceilings are mostly out of reach.
"""

from dataclasses import replace

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.base import ELEVATION, MEASURED, RAY_BOUNDED, Reconstruction
from survey.reconstruction.line_of_sight.ceiling import LowestRays, steepness
from survey.reconstruction.line_of_sight.ghost_returns import ghosts
from survey.reconstruction.line_of_sight.sight_lines import checked_origins, ends_far_below
from survey.reconstruction.nodes import NodeWindow, bilinear

_MISS = 0.025


def below_sight_lines(reconstruction: Reconstruction, points: SurfacePoints) -> Reconstruction:
    """Return a map with bounds that know its points' lines of sight.

    Rays of ghost returns, and rays that end far below the map, count for nothing; over every
    node the third-lowest of the others does.

    Parameters
    ----------
    reconstruction : Reconstruction
        By any method that states a standard deviation.
    points : SurfacePoints
        What it was made from, with the sensor's origins.

    Raises
    ------
    InputError
        Lines of sight that make no sense, or a map of another quantity than elevation.

    Notes
    -----
    The standard deviation is taken to be right, and errors to be normal: the bounds are as good
    as they are. `FieldLattice` has bounds that were held to hidden ground.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 8.0, 2.0), 1.0)
    >>> high, wide = Dem.on(grid, np.full(grid.shape, 1.0)), Dem.on(grid, np.full(grid.shape, 1.0))
    >>> bridged = Reconstruction(high, wide, np.ones(grid.shape, dtype=int), "gp", {})
    >>> far = SurfacePoints([[8.0, 1.0, 0.0]] * 3, sigma_m=0.01, origins=[[0.0, 1.0, 1.0]] * 3, crs=grid.crs)
    >>> below_sight_lines(bridged, far).mean.elevation[1].round(1)
    array([ 0.2,  0.2,  0.1,  0. , -0.1, -0.2, -0.3,  1. ,  1. ])
    """
    if reconstruction.quantity != ELEVATION:
        raise InputError(
            f"lines of sight bound elevations, and {reconstruction.quantity} is mapped; leave the rays out."
        )
    ceiling = _ceiling(reconstruction, points)
    mean, std, lower, upper = truncated(reconstruction.mean.elevation, reconstruction.std.elevation, ceiling)
    covered = np.isfinite(ceiling) & np.isfinite(mean) & (reconstruction.support != MEASURED)
    grid, datum = reconstruction.mean.grid(), reconstruction.mean.vertical_datum
    return replace(
        reconstruction,
        mean=Dem.on(grid, mean, datum),
        std=Dem.on(grid, std, datum),
        lower=Dem.on(grid, lower, datum),
        upper=Dem.on(grid, upper, datum),
        support=np.where(covered, RAY_BOUNDED, reconstruction.support),
        diagnostics={**reconstruction.diagnostics, "ray_covered_share": float(np.isfinite(ceiling).mean())},
    )


def truncated(
    mean: FloatArray, std: FloatArray, ceiling: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean, standard deviation and the bounds that hold 95 %, given that the height is below a ceiling."""
    # Ten deviations above a ceiling the map is plainly wrong; the tail there has no more digits.
    a = np.clip((ceiling - mean) / std, -10.0, 40.0)
    ratio = np.exp(-0.5 * a * a - log_ndtr(a)) / np.sqrt(2.0 * np.pi)
    shrunk = np.sqrt(np.maximum(1.0 - a * ratio - ratio * ratio, 0.0))
    low, high = (mean + std * ndtri(share * ndtr(a)) for share in (_MISS, 1.0 - _MISS))
    return mean - std * ratio, std * shrunk, low, high


def _ceiling(reconstruction: Reconstruction, points: SurfacePoints) -> FloatArray:
    """Return the greatest height [m] that lines of sight allow on the map's nodes, its first row in the north."""
    origins = checked_origins(points)
    # Nodes count from the south-west corner of the map, whatever it is.
    z, grid = reconstruction.mean.elevation[::-1], reconstruction.mean.grid()
    window = NodeWindow(grid.step_m, 0, 0, *grid.shape)
    corner = np.array([grid.bounds[0], grid.bounds[1], 0.0])
    start, end = origins - corner, points.xyz - corner
    low_m = bilinear(z, window.coordinates(end[:, :2])) - points.z
    accepted = ~ghosts(points.xyz) & ~ends_far_below(low_m, points.sigma_z)
    rays = LowestRays.empty(window.shape)
    rays.add(window, start[accepted], end[accepted], points.sigma_z[accepted])
    slope = steepness(z, grid.step_m)
    ceiling = rays.ceiling(np.where(np.isfinite(slope), slope, 0.0))
    return np.ascontiguousarray(ceiling[::-1])
