"""Priors of the ice's motion: the same everywhere, from the slope of the surface, or from a velocity raster."""

from typing import NamedTuple

import numpy as np

from survey.core import Bounds, FloatArray, InputError, same_crs
from survey.data import Dem
from survey.data.ice_motion import DAY_S, IceMotion

# Neighbouring cells of a tracked velocity share their windows: so many cells count as one.
_CELLS_OF_A_WINDOW = 4.0
# Density of ice times gravity [Pa/m], yield stress [Pa] and rate factor of temperate ice [1/(s Pa³)].
_ICE_PA_M, _YIELD_PA, _RATE_FACTOR = 917.0 * 9.81, 1.0e5, 2.4e-24


def uniform_motion(
    velocity: tuple[float, float],
    lowering: float,
    *,
    velocity_sigma: float,
    lowering_sigma: float,
    epoch_s: float,
    origin_m: tuple[float, float] = (0.0, 0.0),
    velocity_change_sigma: float = 0.0,
) -> IceMotion:
    """Return a motion that is the same everywhere, with independent errors.

    `velocity` (float, float): to the east and to the north [m/day]. `lowering`: rate of lowering [m/day].
    `velocity_sigma`, `lowering_sigma`: standard deviations [m/day]; 0 for what is exact. `epoch_s`: epoch
    [s]. `origin_m` (float, float): origin of the planes [m]. `velocity_change_sigma`: standard deviation of
    the change of velocity over a kilometre [m/day/km]; 0 leaves the planes out.

    >>> uniform_motion((2.0, 0.0), 0.1, velocity_sigma=0.5, lowering_sigma=0.0, epoch_s=0.0).n_unknowns
    2
    """
    m = 3 if velocity_change_sigma > 0.0 else 1
    coefficients, sigma = np.zeros((3, m)), np.zeros((3, m))
    coefficients[:, 0] = (*velocity, lowering)
    sigma[:2, 1:] = velocity_change_sigma
    sigma[:, 0] = (velocity_sigma, velocity_sigma, lowering_sigma)
    return IceMotion.of(
        coefficients, np.diag(sigma.ravel() ** 2), epoch_s=epoch_s, origin_m=np.asarray(origin_m, dtype=float)
    )


class VelocityRasters(NamedTuple):
    """Rasters of velocity with their errors, all on one grid.

    `east`, `north`: velocity to the east and to the north [m/day]. `sigma_east`, `sigma_north`: standard
    deviations [m/day].
    """

    east: Dem
    north: Dem
    sigma_east: Dem
    sigma_north: Dem


def motion_from_rasters(
    rasters: VelocityRasters, bounds: Bounds, *, lowering_sigma: float, epoch_s: float, lowering: float = 0.0
) -> IceMotion:
    """Return the motion that velocity rasters state for a site: a constant and planes of each component.

    `bounds` (xmin, ymin, xmax, ymax): extent of the site [m]; cells about it, as far as it is wide, count
    too. `lowering_sigma`: standard deviation of the lowering [m/day]. `epoch_s`: epoch [s]. `lowering`:
    expected lowering [m/day].

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 400.0, 400.0), 40.0)
    >>> east, north, sigma = (Dem.on(grid, np.full(grid.shape, rate)) for rate in (0.3, 0.1, 0.02))
    >>> rasters = VelocityRasters(east, north, sigma, sigma)
    >>> motion = motion_from_rasters(rasters, grid.bounds, lowering_sigma=0.05, epoch_s=0.0)
    >>> motion.rates(np.array([[200.0, 200.0]])).round(3).tolist()
    [[0.3, 0.1, 0.0]]
    """
    for other in rasters[1:]:
        same_crs(rasters.east.crs, other.crs, "the rasters of the velocity")
    xmin, ymin, xmax, ymax = bounds
    middle = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
    reach = max(xmax - xmin, ymax - ymin, 3.0 * rasters.east.step_m)
    xy = rasters.east.xy
    columns = rasters.east, rasters.north, rasters.sigma_east, rasters.sigma_north
    values = np.column_stack([raster.elevation.ravel() for raster in columns])
    inside = (np.abs(xy - middle) <= reach).all(axis=1) & np.isfinite(values).all(axis=1)
    if inside.sum() < 6:
        raise InputError(
            f"the rasters of the velocity have {int(inside.sum())} known cells about the site; at least 6 are needed."
        )
    basis = np.column_stack([np.ones(inside.sum()), (xy[inside] - middle) / 1000.0])
    coefficients, covariance = np.zeros((3, 3)), np.zeros((9, 9))
    for k in (0, 1):
        part = slice(3 * k, 3 * k + 3)
        coefficients[k], covariance[part, part] = _plane(basis, values[inside, k], values[inside, 2 + k])
    coefficients[2, 0], covariance[6, 6] = lowering, lowering_sigma**2
    return IceMotion.of(coefficients, covariance, epoch_s=epoch_s, origin_m=middle)


def _plane(basis: FloatArray, velocity: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the plane (3,) of least squares through velocities (N,), and its covariance (3, 3)."""
    plane = np.linalg.lstsq(basis, velocity)[0]
    scatter = np.var(velocity - basis @ plane) * _CELLS_OF_A_WINDOW
    covariance: FloatArray = np.asarray(scatter * np.linalg.inv(basis.T @ basis))
    covariance[0, 0] += np.mean(sigma**2)
    return np.asarray(plane), covariance


def motion_from_slope(
    dem: Dem, *, lowering_sigma: float, epoch_s: float, shape_factor: float = 0.8
) -> IceMotion:
    r"""Return the motion of a glacier of which only the surface is known: along the fall line, within an order of magnitude.

    Ice that is as thick as its yield stress allows, :math:`H = \tau / (f \rho g \sin \alpha)`, deforms by
    :math:`2 A \tau^3 H / 4` a second at its surface; sliding adds up to several times that. The expected velocity is
    twice the deformation, and its standard deviation along the fall line is five times it; across it is a third of that.

    `lowering_sigma`: standard deviation of the lowering, whose mean is 0 [m/day]. `epoch_s`: epoch [s].

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 400.0, 400.0), 20.0)
    >>> downhill_to_the_east = Dem.on(grid, 1000.0 - 0.1 * grid.xy[:, 0].reshape(grid.shape))
    >>> motion = motion_from_slope(downhill_to_the_east, lowering_sigma=0.05, epoch_s=0.0)
    >>> east, north, up = motion.rates(np.array([[200.0, 200.0]]))[0]
    >>> bool(east > 0.0), abs(round(float(north), 6)), float(up)
    (True, 0.0, 0.0)
    """
    east, north = (float(np.nanmean(part)) for part in dem.gradient())
    slope = float(np.hypot(east, north))
    if not slope > 0.0:
        raise InputError("the surface has no slope along which ice could flow; state the velocity instead.")
    thickness_m = plastic_thickness_m(slope, shape_factor)
    deformation = 0.5 * _RATE_FACTOR * _YIELD_PA**3 * thickness_m * DAY_S
    along = np.array([-east, -north]) / slope
    across = np.array([-along[1], along[0]])
    spread = 25.0 * deformation**2 * (np.outer(along, along) + np.outer(across, across) / 9.0)
    covariance = np.zeros((3, 3))
    covariance[:2, :2], covariance[2, 2] = spread, lowering_sigma**2
    coefficients = np.array([*(2.0 * deformation * along), 0.0])[:, None]
    return IceMotion.of(coefficients, covariance, epoch_s=epoch_s, origin_m=dem.grid().xy.mean(axis=0))


def plastic_thickness_m(slope: float, shape_factor: float = 0.8) -> float:
    r"""Return the thickness at which ice of a surface slope yields at its bed, :math:`H = \tau / (f \rho g \sin \alpha)`.

    Returns: thickness [m], within a factor of about two.

    >>> round(plastic_thickness_m(0.1))
    140
    """
    return float(_YIELD_PA / (shape_factor * _ICE_PA_M * slope / np.hypot(1.0, slope)))
