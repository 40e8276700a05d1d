"""Generalised least squares for the free part of a mean: a height, or a plane."""

from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from survey.arrays import FloatArray
from survey.errors import InputError


class Engine(Protocol):
    """A zero-mean Gaussian process conditioned on points: what the dense and the Fourier engine share."""

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of the residuals."""

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at the places (M, 2)."""

    def mean(self, xy: FloatArray) -> FloatArray:
        """Return the mean (M,) at the places (M, 2)."""

    def for_residual(self, residual: FloatArray) -> Self:
        """Return the engine for other residuals at the same places: the factor is kept."""

    def update(self, xy: FloatArray, residual: FloatArray, noise_variance: FloatArray) -> Self:
        """Return the engine for more points."""

    def sample(self, xy: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, M)."""


@dataclass(frozen=True)
class Trend:
    r"""Coefficients of a trend under a Gaussian process, and their covariance.

    .. math::  \hat\beta = (H^T V^{-1} H)^{-1} H^T V^{-1} r, \qquad V = K + D

    (Rasmussen and Williams 2006, Eqs. 2.41–2.42, in the limit of a vague prior.)
    """

    coefficients: FloatArray
    covariance: FloatArray
    columns: tuple[Engine, ...] = field(default=(), repr=False)

    @classmethod
    def fitted(
        cls, engine: Engine, noise: FloatArray, terms: FloatArray, xy: FloatArray, r: FloatArray
    ) -> Self:
        """Fit the terms (N, p) to residuals r (N,) measured at xy with a noise variance each."""
        columns = tuple(engine.for_residual(column) for column in terms.T)
        # V⁻¹h = D⁻¹(h − smoothed h): no matrix but the engine's own is factorized.
        whitened = np.column_stack([(h - e.mean(xy)) / noise for h, e in zip(terms.T, columns, strict=True)])
        information = terms.T @ whitened
        try:
            factor = cho_factor(0.5 * (information + information.T))
        except np.linalg.LinAlgError as error:
            raise InputError(
                "the points do not determine the mean, because they lie on one line or spot; take mean = constant."
            ) from error
        covariance = cho_solve(factor, np.eye(len(information)))
        return cls(covariance @ (whitened.T @ r), covariance, columns)

    def unexplained(self, terms: FloatArray, xy: FloatArray) -> FloatArray:
        """Return what the engine cannot tell of each term at the places: H* − K*V⁻¹H, (M, p)."""
        return terms - np.column_stack([engine.mean(xy) for engine in self.columns])
