"""Whitened sparse least-squares rows over the nodes of a path."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import sparse

from survey.core.arrays import FloatArray, IntArray

PER_NODE = 13
"""Unknowns of a node: position (3), yaw, pitch, roll, GPS bias (3), barometer's drift, scale, slow part of yaw, gyro's bias."""
E, YAW, PITCH, ROLL, BIAS, DRIFT, SCALE, HEADING, GYRO = 0, 3, 4, 5, 6, 9, 10, 11, 12
DELAY, MEAN_SCALE, WHEEL_SCALE, SKID, DATUM, PITCH_BIAS, ROLL_BIAS, FORCE_PITCH, FORCE_ROLL = range(-9, 0)
"""Unknowns that all nodes share, counted from the end; the delay of the fixes is left out where it is known. Those of
the ice's motion come before them."""
N_GLOBALS = 8
"""Number of shared unknowns without the delay of the fixes."""

Term = tuple[IntArray, FloatArray]


@dataclass
class NormalEquations:
    """Rows ``Σ coefficient · unknown = value ± sigma``, and what they amount to."""

    n_nodes: int
    has_delay: bool = False
    n_motion: int = 0
    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    entries: list[FloatArray] = field(default_factory=list)
    right: list[FloatArray] = field(default_factory=list)
    log_sigma: float = 0.0
    n_rows: int = 0

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns, globals included."""
        return self.n_nodes * PER_NODE + self.n_motion + N_GLOBALS + self.has_delay

    def motion_terms(self, by: FloatArray) -> list[Term]:
        """Return the terms of the unknowns of the ice's motion, from coefficients (N, R); they stand behind the nodes."""
        first = self.n_nodes * PER_NODE
        return [(np.array(first + k), column) for k, column in enumerate(by.T)]

    def add(self, terms: list[Term], value: FloatArray, sigma: FloatArray) -> None:
        """Add rows; a term's columns and coefficients have one entry a row, or one for all."""
        n = len(value)
        row = self.n_rows + np.arange(n)
        for column, coefficient in terms:
            self.rows.append(row)
            self.columns.append(np.broadcast_to(column, n) % self.n_unknowns)
            self.entries.append(coefficient / sigma)
        self.right.append(value / sigma)
        self.log_sigma += float(np.log(np.broadcast_to(sigma, n)).sum())
        self.n_rows += n

    def add_prior(self, which: IntArray | int, sigma: float) -> None:
        """Add the prior 0 ± sigma of one unknown."""
        one = np.ones(1)
        self.add([(np.atleast_1d(np.asarray(which)), one)], 0.0 * one, sigma * one)

    def add_gauss_markov(self, which: int, memory: FloatArray, sigma: float, mean: int | None = None) -> None:
        """Add a Gauss-Markov process: x' − μ' = memory · (x − μ) + noise that keeps the variance.

        The mean μ is another unknown, a global or of the node.
        """
        before = np.arange(len(memory))
        first, one, ones = np.zeros(1, dtype=np.int64), np.ones(1), np.ones(len(memory))
        steps: list[Term] = [(unknown(before + 1, which), ones), (unknown(before, which), -memory)]
        start: list[Term] = [(unknown(first, which), one)]
        if mean is not None:
            steps += [(unknown(before + 1, mean), -ones), (unknown(before, mean), memory)]
            start.append((unknown(first, mean), -one))
        noise = sigma * np.sqrt(np.maximum(1.0 - memory**2, 1e-12))
        self.add(steps, np.zeros(len(memory)), noise)
        self.add(start, 0.0 * one, sigma * one)

    def add_turning_gauss_markov(
        self,
        pair: tuple[int, int],
        memory: FloatArray,
        turn_rad: FloatArray,
        sigma: float,
        means: tuple[int, int],
    ) -> None:
        """Add a Gauss-Markov process of a vector that stays in the world while the axes of its components turn.

        With x, y the components about their means on axes that turn by Δψ from node to node,

            x' = memory · (cos Δψ · x + sin Δψ · y) + noise,    y' = memory · (cos Δψ · y − sin Δψ · x) + noise.
        """
        before, ones, one = np.arange(len(memory)), np.ones(len(memory)), np.ones(1)
        noise = sigma * np.sqrt(np.maximum(1.0 - memory**2, 1e-12))
        along, across = memory * np.cos(turn_rad), memory * np.sin(turn_rad)
        for own, other, sign in ((0, 1, 1.0), (1, 0, -1.0)):
            terms: list[Term] = [
                (unknown(before + 1, pair[own]), ones),
                (unknown(before, means[own]), along - ones),
            ]
            terms += [(unknown(before, pair[own]), -along), (unknown(before, pair[other]), -sign * across)]
            terms.append((unknown(before, means[other]), sign * across))
            self.add(terms, np.zeros(len(memory)), noise)
            first = np.zeros(1, dtype=np.int64)
            start: list[Term] = [(unknown(first, pair[own]), one), (unknown(first, means[own]), -one)]
            self.add(start, 0.0 * one, sigma * one)

    def add_walk(self, which: int, sigma: FloatArray) -> None:
        """Let an unknown change from node to node by independent steps of standard deviations (K - 1,)."""
        before, ones = np.arange(len(sigma)), np.ones(len(sigma))
        self.add([(unknown(before + 1, which), ones), (unknown(before, which), -ones)], 0.0 * ones, sigma)

    @property
    def design(self) -> Any:
        """The whitened rows, sparse."""
        place = (np.concatenate(self.rows), np.concatenate(self.columns))
        return sparse.csr_array((np.concatenate(self.entries), place), shape=(self.n_rows, self.n_unknowns))

    @property
    def values(self) -> FloatArray:
        """The whitened right-hand side."""
        return np.concatenate(self.right)


def unknown(nodes: IntArray | int, which: int) -> IntArray:
    """Return the column of one unknown of some nodes; a global is the same for all."""
    own: IntArray = np.asarray(nodes, dtype=np.int64) * PER_NODE
    return own + which if which >= 0 else np.full_like(own, which)
