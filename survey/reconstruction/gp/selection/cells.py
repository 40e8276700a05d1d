"""Cells of the lattice of covariances: family, length scale and ratio of the variances."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.distance import cdist

from survey.core.arrays import BoolArray, FloatArray
from survey.reconstruction.gp.covariance.families import SearchedFamily
from survey.reconstruction.gp.covariance.kernels import KINDS
from survey.reconstruction.gp.covariance.stationary import Stationary

PER_DOUBLING = 4
"""Length scales of the lattice per doubling."""


LEAST_RATIO = -28
"""Exponent of 2 of the least ratio of variances: a perfect sensor errs by 0.3 mm where the terrain varies by 5 m."""


class Cell(NamedTuple):
    """A covariance up to its variance: family, length scale 2^(length/4) m, ratio 2^ratio."""

    family: SearchedFamily
    length: float
    ratio: float

    @classmethod
    def of(cls, family: SearchedFamily, length_scale_m: float, ratio: float) -> "Cell":
        """Return the cell of a given covariance; its length scale and ratio need not lie on the lattice."""
        length = PER_DOUBLING * float(np.log2(length_scale_m))
        return cls(family, length, max(float(np.log2(max(ratio, 1e-300))), LEAST_RATIO))

    @property
    def length_scale_m(self) -> float:
        """Length scale [m]."""
        return float(2.0 ** (self.length / PER_DOUBLING))

    @property
    def kind(self) -> type[Stationary]:
        """Class of the covariance function."""
        return KINDS[self.family]

    def kernel(self, variance_m2: float) -> Stationary:
        """Return the covariance function with this variance."""
        return self.kind(variance_m2, self.length_scale_m)

    def correlation(self, squared_m2: FloatArray) -> FloatArray:
        """Return the correlation at squared distances [m²]."""
        return self.kernel(1.0)._correlation(squared_m2 / self.length_scale_m**2)

    def factor(self, xy: FloatArray) -> FloatArray | None:
        """Return L (N, N) of the samples' correlation in a lower triangle, or None where rounding makes it indefinite."""
        return self.factor_of(triangle(xy))

    def factor_of(self, triangle: Iterable[tuple[slice, FloatArray]]) -> FloatArray | None:
        """Return the factor from squared distances [m²], given some rows at a time from the diagonal on."""
        correlation, scale = self.kernel(1.0)._correlation, self.length_scale_m**-2
        blocks = [(rows, correlation(scale * squared_m2)) for rows, squared_m2 in triangle]
        n = blocks[-1][0].stop
        matrix = np.empty((n, n))
        for rows, block in blocks:
            matrix[rows, rows.start :] = block
        matrix.flat[:: n + 1] += 2.0**self.ratio
        return factorized(matrix)


@dataclass(frozen=True)
class Likelihood:
    """Log likelihood (B,) and terrain variance (B,) [m²] of one cell, survey by survey."""

    log: FloatArray
    variance_m2: FloatArray


Wish = tuple[Cell, BoolArray]
"""A cell, and the surveys (B,) that request its likelihood."""


@dataclass(frozen=True)
class FoundKernel:
    """The likeliest covariance of one survey: its cell, and the terrain's variance [m²]."""

    cell: Cell
    variance_m2: float

    @property
    def kernel(self) -> Stationary:
        """The covariance function [m²]."""
        return self.cell.kernel(self.variance_m2)

    @property
    def noise_m(self) -> float:
        """Standard deviation of a sample that goes with it [m]."""
        return float(np.sqrt(2.0**self.cell.ratio * self.variance_m2))


def blocks(n: int, size: int = 64) -> Iterator[slice]:
    """Return the rows that are worked on together, so that they stay in the processor's cache."""
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def triangle(xy: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
    """Squared distances [m²] of some rows at a time, from the diagonal on: a factorization reads one triangle alone."""
    return ((rows, cdist(xy[rows], xy[rows.start :], "sqeuclidean")) for rows in blocks(len(xy)))


def solved(factor: FloatArray, columns: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Return L⁻¹ B, or L⁻ᵀ B; a factor of a positive definite matrix has no zero that could fail."""
    solved: FloatArray = lapack.dtrtrs(factor, columns, lower=1, trans=int(transposed))[0]
    return solved


def factorized(matrix: FloatArray) -> FloatArray | None:
    """Return the Cholesky factor in the lower triangle, or None where rounding makes the matrix indefinite."""
    factor, failed = lapack.dpotrf(matrix.T, lower=1, overwrite_a=1, clean=0)
    return None if failed else factor
