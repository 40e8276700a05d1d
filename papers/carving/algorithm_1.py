"""Algorithm 1 of the carving paper as it is printed, beside which the space-carving kernels are compared.

A point and its line of sight are visited together, one learning rate serves both and falls with every basis, and
nothing limits what a line of sight may press down. The line is searched at equal steps with the exact surface.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray, IntArray
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.descent import (
    BY_POINT,
    BY_RAY,
    Bases,
    Fresh,
    LevelCells,
    Step,
    add_fresh,
    fresh_height,
    height_at,
)
from survey.reconstruction.line_of_sight.returns import checked_origins

_SEARCH_M = 0.2
"""Step of the search along a line of sight [m]; the paper states none."""
_PASSES_TO_SLOW = 4.0


class Progressed(NamedTuple):
    """State after a pass: number of bases made so far, and the factor by which all weights have decayed."""

    n_bases: int
    decayed: float


@dataclass(eq=False)
class LiteralCarving:
    """Surface by Algorithm 1: points and lines of sight in one order, with one learning rate.

    Parameters
    ----------
    config : SpaceCarvingConfig
        Length scales, η₀, λ, dead-band and prior; `ray_rate`, `ray_sigmas`, `gate` and `bounds` are not used.
    is_rate_strict : bool
        Whether η is proportional to t^(-1/2) from the first basis t on, and not as in `config`, after four
        passes' worth of bases.
    """

    config: SpaceCarvingConfig
    is_rate_strict: bool = False
    n_bases_: int = field(default=0, init=False)
    _bases: Bases | None = field(default=None, init=False)
    _corner: FloatArray = field(default_factory=lambda: np.zeros(2), init=False)
    _prior_m: float = field(default=0.0, init=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Make all passes over the points.

        Raises
        ------
        InputError
            Points without lines of sight.
        """
        config, origins = self.config, checked_origins(points)
        lengths = config.lengths_m()
        low = np.minimum(points.xy.min(axis=0), origins[:, :2].min(axis=0)) - lengths[0]
        high = np.maximum(points.xy.max(axis=0), origins[:, :2].max(axis=0)) + lengths[0]
        shift = np.array([*low, 0.0])
        xyz, sensors = points.xyz - shift, origins - shift
        cells = LevelCells.over(lengths, *(high - low).tolist())
        self._corner, self._bases = low, Bases.none(cells)
        self._prior_m = float(np.median(points.z)) if config.prior_m is None else config.prior_m
        rng, progressed = stream(config.seed, "algorithm 1"), Progressed(0, 1.0)
        for level in range(len(lengths)):
            fresh = Fresh.on(cells, level, 2 * len(xyz))
            order = rng.permutation(len(xyz))
            progressed = visit(xyz, sensors, order, (self._bases, fresh), self._step(len(xyz)), progressed)
            self._bases = self._bases.merged(fresh.taken(level))
        self._bases = self._bases._replace(weight=self._bases.weight * progressed.decayed)
        self.n_bases_ = progressed.n_bases
        return self

    def predict(self, xy: FloatArray) -> FloatArray:
        """Return the surface's height (N,) at places (N, 2) [m]."""
        assert self._bases is not None
        return self._prior_m + self._bases.heights(xy - self._corner)

    def _step(self, n: int) -> Step:
        config = self.config
        slow_after = 1.0 if self.is_rate_strict else _PASSES_TO_SLOW * n
        rate = config.rate
        return Step(
            self._prior_m, config.dead_band_m, rate, slow_after, config.decay, config.carve, ray_rate=rate
        )


@njit(cache=True)
def visit(  # noqa: PLR0917 - compiled functions take no keywords
    xyz: FloatArray,
    sensors: FloatArray,
    order: IntArray,
    bases: tuple[Bases, Fresh],
    step: Step,
    progressed: Progressed,
) -> Progressed:
    """Visit every point and its line of sight once, in the given order; weights are stored relative to the decay so far."""
    fresh = bases[1]
    t, decayed = progressed.n_bases, progressed.decayed
    for i in order:
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        residual = _height(bases, x, y, step.prior_m, decayed) - z
        if abs(residual) > step.dead_band_m:
            add_fresh(fresh, x, y, -_rate(step, t) * residual / decayed, BY_POINT)
            t += 1
        if step.carve:
            x, y, depth = _worst(bases, xyz[i], sensors[i], step.prior_m, decayed)
            if depth > step.dead_band_m:
                add_fresh(fresh, x, y, -_rate(step, t) * depth / decayed, BY_RAY)
                t += 1
        decayed *= 1.0 - _rate(step, t) * step.decay
    return Progressed(t, decayed)


@njit(cache=True)
def _rate(step: Step, t: int) -> float:
    """Return the learning rate η_t."""
    return float(step.rate / np.sqrt(1.0 + t / step.slow_after))


@njit(cache=True)
def _height(bases: tuple[Bases, Fresh], x: float, y: float, prior_m: float, decayed: float) -> float:
    """Return the height of the surface [m]."""
    return prior_m + decayed * (height_at(bases[0], x, y) + fresh_height(bases[1], x, y))


@njit(cache=True)
def _worst(
    bases: tuple[Bases, Fresh], hit: FloatArray, sensor: FloatArray, prior_m: float, decayed: float
) -> tuple[float, float, float]:
    """Return where a line of sight is deepest under the surface, and how deep [m]; 0 where it is nowhere."""
    dx, dy, dz = sensor[0] - hit[0], sensor[1] - hit[1], sensor[2] - hit[2]
    n = int(np.sqrt(dx * dx + dy * dy) / _SEARCH_M)
    at_x, at_y, deepest = hit[0], hit[1], 0.0
    for k in range(1, n + 1):
        u = k / n
        x, y = hit[0] + u * dx, hit[1] + u * dy
        depth = _height(bases, x, y, prior_m, decayed) - (hit[2] + u * dz)
        if depth > deepest:
            at_x, at_y, deepest = x, y, depth
    return at_x, at_y, deepest
