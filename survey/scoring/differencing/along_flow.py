r"""Change between two surveys of ice that flows: along the flow, and with the divergence of the flux.

With the displacement d from the earlier survey to the later one, the change at fixed places (Eulerian) and along the flow
(Lagrangian) are

.. math::  \Delta_E = z_2(x) - z_1(x), \qquad \Delta_L = z_2(x + d) - z_1(x)

Mass is conserved at fixed places: the gain at surface and bed is :math:`b = \Delta_E + \nabla \cdot (\gamma H d)`, with the
thickness H and the ratio γ of the mean velocity of a column to that of its surface. Within an outline that ice neither
enters nor leaves the mean divergence is 0.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from shapely import MultiPolygon, Polygon

from survey.core import BoolArray, FloatArray, InputError, IntArray
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.motion.priors import plastic_thickness_m
from survey.scoring.differencing.displacements import DisplacementField
from survey.scoring.differencing.volume_change import (
    AlongFlow,
    Change,
    ComparedGround,
    FlowBalance,
    VolumeChange,
)

# Nodes on which the displacement and its covariance are evaluated, about.
_MOST_NODES = 900
# Mean velocity of a column over that of its surface: 0.8 where ice deforms alone, 1 where it slides alone.
_COLUMN_SHARE, _COLUMN_SHARE_ERROR = 0.9, 0.058
# Relative error of the thickness at which ice yields.
_PLASTIC_ERROR = 0.5


class Thickness(NamedTuple):
    """Thickness of the ice.

    Parameters
    ----------
    value : Dem or float
        Raster, or one value [m].
    relative_std : float
        Standard deviation over the thickness, common to all places.
    """

    value: Dem | float
    relative_std: float = 0.2


class _Nodes(NamedTuple):
    """Nodes over a raster, with the displacement there (2, N), its covariance (2, N, N), and cells (M, 2) with their nearest node."""

    grid: Grid
    shift: FloatArray
    covariance: FloatArray
    cells: FloatArray
    nearest: IntArray

    @classmethod
    def over(cls, raster: Dem, field: DisplacementField) -> "_Nodes":
        xmin, ymin, xmax, ymax = raster.bounds
        step_m = max(np.sqrt((xmax - xmin) * (ymax - ymin) / _MOST_NODES), raster.step_m)
        grid = Grid.over(raster.bounds, float(step_m), raster.crs)
        shift, covariance = field.shift(grid.xy).T, field.covariance(grid.xy)
        if not (np.isfinite(shift).all() and np.isfinite(covariance).all()):
            raise InputError(
                "the flow is not known all over the two surveys; cut them to where it is, or fill its gaps."
            )
        xy = raster.grid().xy
        column = np.rint((xy[:, 0] - grid.x[0]) / grid.step_m).astype(np.int64)
        row = np.rint((grid.y[0] - xy[:, 1]) / grid.step_m).astype(np.int64)
        return cls(grid, shift, covariance, xy, row * grid.shape[1] + column)

    def on(self, xy: FloatArray, values: FloatArray) -> FloatArray:
        """Return values of the nodes (N,) at places (M, 2)."""
        return Dem.on(self.grid, values.reshape(self.grid.shape)).at(xy)

    def sums(self, used: BoolArray, values: FloatArray) -> FloatArray:
        """Return the sums (K, N) at the nodes of values (K, M) of the used cells."""
        n, near = len(self.grid.xy), self.nearest[used]
        return np.stack([np.bincount(near, one[used], minlength=n) for one in values])

    def mean_divergence(self, weights: FloatArray) -> FloatArray:
        """Return the factors (2, N) of the displacements in the weighted mean (N,) of their divergence [1/m]."""
        units = np.eye(len(weights)).reshape(-1, *self.grid.shape)
        slopes = np.asarray(np.gradient(units, self.grid.y, self.grid.x, axis=(1, 2)))
        return np.stack([part.reshape(len(weights), -1) @ weights for part in slopes[::-1]])

    def std_of(self, weights: FloatArray) -> float:
        """Return the standard deviation of a sum of the displacements weighted by (2, N)."""
        variance = float(np.einsum("an,anm,am->", weights, self.covariance, weights))
        return float(np.sqrt(max(variance, 0.0)))


def change_along_flow(
    found: Change,
    later: Dem,
    outlines: Mapping[str, Polygon | MultiPolygon],
    field: DisplacementField,
    thickness: Thickness | None = None,
) -> AlongFlow:
    """Follow the change of a moving surface along its flow, and balance its mass.

    `later`: later survey [m]. `outlines`: those of `found` [m].

    The displacement is evaluated on some 900 nodes over the surveys and interpolated between them: shear margins narrower
    than these are smoothed. Where the flow carries ice beyond the later survey the change along it is not known.
    """
    nodes = _Nodes.over(found.difference, field)
    raster, xy, shape = found.difference, found.difference.grid().xy, found.difference.shape
    shift = np.stack([nodes.on(xy, part) for part in nodes.shift])
    std = np.stack([nodes.on(xy, np.sqrt(np.diag(part))) for part in nodes.covariance])
    moved = later.at(xy + shift.T) - later.at(xy)
    if not np.isfinite(moved + raster.elevation.ravel()).any():
        raise InputError(
            f"the flow of up to {np.hypot(*shift).max():.0f} m carries all ice beyond the later survey; check the units of the "
            "velocity and the time between the surveys."
        )
    followed = Dem.on(raster.grid(), raster.elevation + moved.reshape(shape), raster.vertical_datum)
    slope = _slopes_at(later, xy + shift.T)
    spread = np.sqrt(found.std_m**2 + np.sum((slope * std) ** 2, axis=0).reshape(shape))
    balances = [
        _balance(
            volume,
            _mean_along(followed, inside, slope, nodes),
            *_flux_divergence(inside, _thickness(thickness, later, nodes, inside), nodes),
        )
        for volume, inside in zip(
            found.volumes, ComparedGround.of(raster.grid(), outlines, None).inside, strict=True
        )
    ]
    return AlongFlow(followed, spread, shift.reshape(2, *shape), std.reshape(2, *shape), tuple(balances))


def _slopes_at(dem: Dem, xy: FloatArray) -> FloatArray:
    """Return the slopes (2, N) to the east and to the north at places (N, 2)."""
    return np.stack([Dem.on(dem.grid(), part).at(xy) for part in dem.gradient()])


def _thickness(
    stated: Thickness | None, later: Dem, nodes: _Nodes, inside: BoolArray
) -> tuple[FloatArray, float]:
    """Return the thickness at the nodes (N,) and its relative standard deviation; by the mean slope where not stated."""
    if stated is None:
        within = _slopes_at(later, nodes.cells[inside.ravel()])
        slope = float(np.hypot(*np.nanmean(within, axis=1)))
        return np.full(len(nodes.grid.xy), plastic_thickness_m(max(slope, 1e-3))), _PLASTIC_ERROR
    if not isinstance(stated.value, Dem):
        return np.full(len(nodes.grid.xy), float(stated.value)), stated.relative_std
    values = stated.value.at(nodes.grid.xy)
    if not np.isfinite(values).all():
        raise InputError(
            "the thickness is not known all over the two surveys; fill its gaps, with 0 where there is no ice."
        )
    return values, stated.relative_std


def _mean_along(along: Dem, inside: BoolArray, slope: FloatArray, nodes: _Nodes) -> tuple[float, float]:
    """Return the mean change along the flow over an outline (H, W), and what the displacement adds to its error [m]."""
    heights = along.elevation.ravel()
    used = inside.ravel() & np.isfinite(heights) & np.isfinite(slope).all(axis=0)
    if not used.any():
        raise InputError(
            "the flow carries all ice of an outline beyond the later survey; take a smaller outline."
        )
    sums = nodes.sums(used, slope)
    return float(heights[used].mean()), nodes.std_of(sums / used.sum())


def _flux_divergence(
    inside: BoolArray, thickness: tuple[FloatArray, float], nodes: _Nodes
) -> tuple[tuple[float, float], float]:
    """Return the thickness that the flow carried off with its standard deviation, and the mean thickness [m]."""
    share = nodes.sums(inside.ravel(), np.ones((1, inside.size)))[0] / inside.sum()
    ice, relative_std = thickness
    weights = _COLUMN_SHARE * ice * nodes.mean_divergence(share)
    flux = float(np.sum(weights * nodes.shift))
    common = float(np.hypot(relative_std, _COLUMN_SHARE_ERROR / _COLUMN_SHARE)) * flux
    return (flux, float(np.hypot(nodes.std_of(weights), common))), float(ice @ share)


def _balance(
    volume: VolumeChange, mean_along: tuple[float, float], flux: tuple[float, float], thickness_m: float
) -> FlowBalance:
    """Add the divergence of the flux to the change at fixed places."""
    height_std = volume.std_m3 / volume.area_m2
    return FlowBalance(
        volume.name,
        mean_along[0],
        float(np.hypot(height_std, mean_along[1])),
        *flux,
        volume.volume_m3 / volume.area_m2 + flux[0],
        float(np.hypot(height_std, flux[1])),
        thickness_m,
    )
